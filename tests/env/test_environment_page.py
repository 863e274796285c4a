"""docs/environment.md says what the spaces, the info and the configuration say."""

import dataclasses
import inspect
import re
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode as AR
from scipy.spatial.transform import Rotation

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.disturbance import CAUSES, DISTURBANCES
from gplfd_env.doors.randomization import RANDOMIZATIONS, DoorRandomization
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.robot.model import HAND_BODIES, SERVO_DAMPING, SERVO_STIFFNESS
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.info import INFO
from gplfd_env.validation.fields import allowed_range

PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")
IDS = (
    gplfd_env.ENVIRONMENT_ID,
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
    gplfd_env.MOBILE_ENVIRONMENT_ID,
    gplfd_env.GRIPPER_ENVIRONMENT_ID,
)

Rows = list[dict[str, str]]


def table(section: str, number: int = 0) -> Rows:
    """Return the rows of a section's table by column name; backticks removed."""
    body = PAGE.split(f"\n## {section}\n")[1].split("\n## ")[0]
    block = re.findall(r"(?:^\|.*\n)+", body, flags=re.MULTILINE)[number]
    header, _, *lines = (
        [cell.strip().replace("`", "") for cell in line.strip("|").split("|")]
        for line in block.splitlines()
    )
    return [dict(zip(header, line, strict=True)) for line in lines]


def bounds(text: str) -> tuple[float, float]:
    """Read "[low, high]", where π and π/2 may stand for numbers; ∞ for no bound."""
    named = {"π": np.pi, "π/2": np.pi / 2, "∞": np.inf}
    low, high = text.strip("[]()").split(", ")
    values = []
    for word in (low, high):
        sign, magnitude = (-1, word[1:]) if word.startswith("-") else (1, word)
        values.append(sign * named.get(magnitude, 0.0) or sign * float(magnitude))
    return values[0], values[1]


def indices(text: str) -> range:
    first, _, last = text.partition("-")
    return range(int(first), int(last or first) + 1)


def assert_rows_are(rows: Rows, space: gym.Space) -> None:
    assert isinstance(space, gym.spaces.Box)
    covered = []
    for row in rows:
        low, high = bounds(row["bounds"])
        for index in indices(row["index"]):
            covered.append(index)
            assert space.low[index] == pytest.approx(low), row
            assert space.high[index] == pytest.approx(high), row
    assert covered == list(range(space.shape[0]))


@pytest.mark.parametrize(("number", "id"), [*enumerate(IDS)])
def test_action_table_is_the_action_space(
    number: int, id: str, make_env: Callable
) -> None:
    rows = table("Action", number)
    assert_rows_are(rows, make_env(id=id).action_space)
    stiffness = ["N/m"] * 3 + ["N m/rad"] * 3
    further = [[], stiffness, ["m/s", "m/s", "rad/s"], ["m"]][number]
    assert [row["unit"] for row in rows] == ["m"] * 3 + ["rad"] * 3 + further


@pytest.mark.parametrize(
    ("id", "tables"), [*zip(IDS, [(0,), (0,), (0, 1), (0, 2)], strict=True)]
)
def test_observation_table_is_the_observation_space(
    id: str, tables: tuple[int, ...], make_env: Callable
) -> None:
    space = make_env(id=id).observation_space
    assert isinstance(space, gym.spaces.Dict)
    rows = [row for number in tables for row in table("Observation", number)]
    assert {row["key"] for row in rows} == set(space.spaces)
    for key, box in space.spaces.items():
        assert_rows_are([row for row in rows if row["key"] == key], box)


def test_info_table_is_the_info(make_env: Callable) -> None:
    _, info = make_env().reset(seed=0)
    rows = {row["key"]: row for row in table("Info")}
    assert list(rows) == list(info)
    for key, value in info.items():
        shape = f"{value.shape} array" if isinstance(value, np.ndarray) else None
        assert rows[key]["type"] == (shape or type(value).__name__)
        assert rows[key]["unit"] == (INFO[key].unit or "-")
    assert bounds(rows["door_angle"]["range"])[1] == pytest.approx(
        DoorConfig().stop_angle, abs=1e-3
    )


def test_door_table_is_the_configuration() -> None:
    rows = table("Door parameters")
    fields = dataclasses.fields(DoorConfig)
    assert [row["parameter"] for row in rows] == [field.name for field in fields]
    for row, field in zip(rows, fields, strict=True):
        if row["range"] == "-" or row["default"] == "None":
            assert row["default"] == str(field.default)
        else:
            assert float(row["default"]) == pytest.approx(field.default, rel=1e-5)
        if row["range"] != "-":
            allowed = allowed_range(DoorConfig, field.name)
            assert row["unit"] == allowed.unit
            ends = pytest.approx((allowed.low, allowed.high), rel=1e-5)
            assert bounds(row["range"]) == ends


def test_preset_table_is_the_presets() -> None:
    rows = table("Door parameters", 1)
    stated = {
        row.pop("preset"): DoorConfig(**{k: float(v) for k, v in row.items()})
        for row in rows
    }
    described = ", ".join(row["preset"] for row in table("Door parameters", 2))
    others = {name: DOORS[name] for name in described.split(", ")}
    assert stated | others == dict(DOORS)


def drawn(cell: str, unit: str) -> object:
    """Read a cell of the randomization table as `DoorRandomization` has it."""
    scale = np.radians(1.0) if unit == "°" else 1.0
    if cell == "-":
        return None
    if cell.startswith("["):
        return bounds(cell)
    if cell.startswith("±"):
        return pytest.approx(scale * float(cell[2:]), rel=1e-3)
    if " to " in cell:
        return int(cell.split(" to ")[1])
    return tuple(float(number) for number in cell.split(", "))


def test_randomization_table_is_the_presets_and_the_widest_ranges() -> None:
    rows = table("Randomization")
    names = [field.name for field in dataclasses.fields(DoorRandomization)]
    assert [row["parameter"] for row in rows] == names
    *numbers, doors = rows
    assert (doors["mild"], doors["widest"]) == ("given", "standard")
    assert RANDOMIZATIONS["standard"] == DoorRandomization(doors="standard")
    for row in numbers:
        name, unit = row["parameter"], row["unit"]
        for preset in ("mild", "hard"):
            value = getattr(RANDOMIZATIONS[preset], name)
            assert value == drawn(row[preset], unit), (name, preset)
        widest = drawn(row["widest"], unit)
        number = getattr(widest, "expected", widest)
        if unit == "°":
            number = float(f"{number:.4f}")
        other = {"longest_delay": 10} if name == "shortest_delay" else {}
        DoorRandomization(**{name: number, **other})
        wider = np.array(number) + 1 if unit == "periods" else 1.01 * np.array(number)
        beyond = tuple(wider.tolist()) if wider.ndim else wider.item()
        with pytest.raises(ValueError, match=r"outside|whole number"):
            DoorRandomization(**{name: beyond})


def test_disturbance_table_is_the_records() -> None:
    rows = table("Disturbances")
    fields = [
        (cause, field)
        for cause, record in CAUSES.items()
        for field in dataclasses.fields(record)
    ]
    assert [(row["cause"], row["field"]) for row in rows] == [
        (cause, field.name) for cause, field in fields
    ]
    for row, (cause, field) in zip(rows, fields, strict=True):
        if row["range"] == "-":
            assert row["default"] == str(field.default)
            continue
        allowed = allowed_range(CAUSES[cause], field.name)
        assert float(row["default"]) == pytest.approx(field.default, rel=1e-5)
        assert row["unit"] == allowed.unit
        low, high = bounds(row["range"])
        assert (row["range"][0] == "(") == (allowed.above > allowed.low)
        assert low == pytest.approx(max(allowed.low, allowed.above), rel=1e-3)
        assert high == pytest.approx(allowed.high, rel=1e-3)
    presets = [row["preset"] for row in table("Disturbances", 1)]
    assert ["none", *presets] == list(DISTURBANCES)


def test_turned_arc_is_the_one_stated() -> None:
    """The closed form under Randomization, against a rotation by -ψ about y."""
    radius, psi, phi = 0.47, 0.08, 0.9
    c, s = np.cos, np.sin
    x = radius * (c(psi) * s(phi) + s(psi) * (1 - c(phi)))
    z = radius * (s(psi) * s(phi) - c(psi) * (1 - c(phi)))
    stated = re.search(r"x = R \((.*?)\), {4}z = R \((.*?)\),\n\nwith the rot", PAGE)
    assert stated is not None
    assert stated[1] == "cos ψ sin φ + sin ψ (1 - cos φ)"
    assert stated[2] == "sin ψ sin φ - cos ψ (1 - cos φ)"
    arc = handle_pose_on_arc(radius, phi)[:3]
    turned = Rotation.from_rotvec([0.0, -psi, 0.0]).apply(arc)
    assert turned == pytest.approx([x, 0.0, z])


def test_stated_numbers_are_the_code_s(make_env: Callable) -> None:
    env = make_env()
    translation, rotation = table("Servo")
    for row, index in ((translation, 0), (rotation, 1)):
        assert float(row["stiffness"].split()[0]) == SERVO_STIFFNESS[index]
        assert float(row["damping"].split()[0]) == SERVO_DAMPING[index]
    arm_limits = ", ".join(f"{limit:g}" for limit in env.model.jnt_actfrcrange[1:8, 1])
    stated = re.search(r"effort limits \((.*?) N m", PAGE)
    assert stated is not None
    assert stated[1].replace(" and ", ", ") == arm_limits
    hand = sum(env.model.body(name).mass[0] for name in HAND_BODIES)
    assert f"({hand:.2f} kg)" in PAGE
    assert f"{1000 * CONTROL_PERIOD:g} ms: five physics steps of 2 ms" in PAGE
    assert env.model.opt.timestep == 0.002
    for id in IDS:
        assert f"truncated after {gym.spec(id).max_episode_steps} steps" in PAGE


def test_reward_table_is_the_reward(make_env: Callable) -> None:
    _, info = make_env().reset(seed=0)
    assert [row["term"] for row in table("Reward")] == list(info["reward_terms"])


def test_camera_table_is_the_cameras(make_env: Callable) -> None:
    model = make_env().model
    cameras = {model.camera(index).name for index in range(model.ncam)}
    assert {row["camera"] for row in table("Rendering")} == cameras
    modes = [row["render mode"].strip('"') for row in table("Rendering", 1)]
    assert sorted(modes) == sorted(DoorOpeningEnv.metadata["render_modes"])


def defaults(text: str) -> dict[str, str]:
    """Return what the table of arguments in a text gives as their defaults."""
    rows = re.findall(r"^\| (`.*?) \| (.*?) \|", text, flags=re.MULTILINE)
    return {
        name: default.strip('`" ')
        for names, values in rows
        for name, default in zip(
            re.findall(r"`(\w+)`", names), values.split(", "), strict=True
        )
    }


def test_arguments_and_their_defaults() -> None:
    parameters = inspect.signature(DoorOpeningEnv).parameters
    text = PAGE.split("| argument of `gym.make` |")[1].split("## Frames")[0]
    expected = {name: str(p.default) for name, p in parameters.items()}
    assert defaults(text) == expected


def test_vector_environment_s_arguments_and_their_defaults() -> None:
    """Those of the page, and those of the single environment, are all there are."""
    parameters = inspect.signature(DoorOpeningVectorEnv).parameters
    text = PAGE.split("| argument of `gym.make_vec` |")[1].split("| autoreset mode |")[
        0
    ]
    stated = defaults(text)
    single = inspect.signature(DoorOpeningEnv).parameters
    assert stated.keys() | single.keys() == parameters.keys()
    for name, parameter in parameters.items():
        default = getattr(parameter.default, "value", parameter.default)
        if name == "max_episode_steps":
            default = gplfd_env.TIME_LIMIT
        expected = stated.get(name, str(single[name].default) if name in single else "")
        assert str(default) == expected, name


def test_autoreset_table_is_gymnasium_s_modes() -> None:
    modes = [row["autoreset mode"] for row in table("Many doors at once", 1)]
    assert modes == [mode.value for mode in (AR.NEXT_STEP, AR.SAME_STEP, AR.DISABLED)]
    assert len(modes) == len(AR)


def test_reset_options_are_those_the_message_allows(make_env: Callable) -> None:
    stated = [row["option"] for row in table("Reset")]
    with pytest.raises(ValueError, match="unknown reset option") as error:
        make_env().reset(options={"": 0})
    assert re.findall(r'"(\w+)" ', str(error.value)) == stated


def test_every_id_has_a_version() -> None:
    named = [*IDS, gplfd_env.RL_ENVIRONMENT_ID]
    first = [
        id.replace("-v1", "-v0")
        for id in named
        if id != gplfd_env.MOBILE_ENVIRONMENT_ID
    ]
    assert [row["id"] for row in table("Version history")] == [*named, *first]
    registered = {id for id in gym.registry if id.startswith("gplfd/")}
    assert registered == {*named, *first}


@pytest.mark.parametrize("code", re.findall(r"```python\n(.*?)```", PAGE, re.S))
def test_code_on_the_page_runs(code: str) -> None:
    env = gym.make(IDS[0])
    names = {"gym": gym, "env": env, "action": np.zeros(6)}
    exec(code, names)
    names["env"].close()
    env.close()


def test_seed_changes_nothing(make_env: Callable) -> None:
    """As the page says: without randomization nothing is drawn."""
    env = make_env("small")
    first, _ = env.reset(seed=1)
    second, _ = env.reset(seed=2)
    for key in first:
        assert np.array_equal(first[key], second[key])
