"""docs/environment.md says what the spaces, the info and the configuration say."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env.config import DOORS, DoorConfig
from gplfd_env.door import HINGE_RANGE
from gplfd_env.door_opening import CONTROL_PERIOD, DoorOpeningEnv
from gplfd_env.robot import HAND_BODIES, SERVO_DAMPING, SERVO_STIFFNESS

PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")

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
    """Read "[low, high]", where π and π/2 may stand for numbers."""
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


def test_action_table_is_the_action_space(make_env: Callable) -> None:
    rows = table("Action")
    assert_rows_are(rows, make_env().action_space)
    assert [row["unit"] for row in rows] == ["m"] * 3 + ["rad"] * 3


def test_observation_table_is_the_observation_space(make_env: Callable) -> None:
    space = make_env().observation_space
    assert isinstance(space, gym.spaces.Dict)
    rows = table("Observation")
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
    assert bounds(rows["door_angle"]["range"])[1] == pytest.approx(
        HINGE_RANGE, abs=1e-3
    )


def test_door_table_is_the_configuration() -> None:
    rows = table("Door parameters")
    fields = dataclasses.fields(DoorConfig)
    assert [row["parameter"] for row in rows] == [field.name for field in fields]
    for row, field in zip(rows, fields, strict=True):
        assert float(row["default"]) == field.default
        low, high = bounds(row["range"])
        for value in (low, high):
            DoorConfig(**{field.name: value})
        for value in (np.nextafter(low, -1), np.nextafter(high, np.inf)):
            with pytest.raises(ValueError, match=re.escape(f"{field.name} = ")):
                DoorConfig(**{field.name: float(value)})


def test_preset_table_is_the_presets() -> None:
    rows = table("Door parameters", 1)
    stated = {
        row.pop("preset"): DoorConfig(**{k: float(v) for k, v in row.items()})
        for row in rows
    }
    assert stated == dict(DOORS)


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
    spec = gym.spec("gplfd/DoorOpening-v0")
    assert f"truncated after {spec.max_episode_steps} steps" in PAGE


def test_reward_table_is_the_reward(make_env: Callable) -> None:
    _, info = make_env().reset(seed=0)
    assert [row["term"] for row in table("Reward")] == list(info["reward_terms"])


def test_camera_table_is_the_cameras(make_env: Callable) -> None:
    model = make_env().model
    cameras = {model.camera(index).name for index in range(model.ncam)}
    assert {row["camera"] for row in table("Rendering")} == cameras


def test_arguments_and_their_defaults() -> None:
    import inspect

    parameters = inspect.signature(DoorOpeningEnv).parameters
    body = PAGE.split("## Frames")[0]
    rows = re.findall(r"^\| (`.*?) \| (.*?) \|", body, flags=re.MULTILINE)
    stated = {
        name: default.strip('`" ')
        for names, defaults in rows
        for name, default in zip(
            re.findall(r"`(\w+)`", names), defaults.split(", "), strict=True
        )
    }
    assert stated == {name: str(p.default) for name, p in parameters.items()}


def test_seed_changes_nothing(make_env: Callable) -> None:
    """As the page says: the environment draws no random numbers."""
    env = make_env("small")
    first, _ = env.reset(seed=1)
    second, _ = env.reset(seed=2)
    for key in first:
        assert np.array_equal(first[key], second[key])
