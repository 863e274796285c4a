"""docs/environment.md says what the spaces, the info and the configuration say."""

import dataclasses
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gplfd_env
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.disturbance import CAUSES, DISTURBANCES
from gplfd_env.doors.parts import Closer
from gplfd_env.task.info import INFO
from gplfd_env.validation.fields import allowed_range

PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")
IDS = (
    gplfd_env.ENVIRONMENT_ID,
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
    gplfd_env.MOBILE_ENVIRONMENT_ID,
    gplfd_env.GRIPPER_ENVIRONMENT_ID,
)
PARTS = ("leaf", "lockset", "closer", "mechanism")
"""Parts of a door with their own parameters."""
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


def column(section: str, name: str, number: int = 0) -> list[str]:
    return [row[name] for row in table(section, number)]


def number(word: str) -> float:
    """Read a number, π, π/2 or ∞, with or without a minus."""
    named = {"π": np.pi, "π/2": np.pi / 2, "∞": np.inf}
    magnitude = word.removeprefix("-")
    size = named[magnitude] if magnitude in named else float(magnitude)
    return -size if word.startswith("-") else size


def bounds(text: str) -> tuple[float, float]:
    """Read "[low, high]"."""
    low, high = text.strip("[]()").split(", ")
    return number(low), number(high)


def assert_rows_are(rows: Rows, space: Any) -> None:
    covered = []
    for row in rows:
        first, _, last = row["index"].partition("-")
        indices = slice(int(first), int(last or first) + 1)
        covered += range(indices.start, indices.stop)
        low, high = bounds(row["bounds"])
        assert space.low[indices] == pytest.approx(low), row
        assert space.high[indices] == pytest.approx(high), row
    assert covered == list(range(space.shape[0]))


# --- Tables --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("id", "action", "observation", "further"),
    [
        (IDS[0], 0, (0,), []),
        (IDS[1], 1, (0,), ["N/m"] * 3 + ["N m/rad"] * 3),
        (IDS[2], 2, (0, 1), ["m/s", "m/s", "rad/s"]),
        (IDS[3], 3, (0, 2), ["m"]),
    ],
)
def test_tables_of_spaces(id, action, observation, further, make_env):
    env = make_env(id=id)
    rows = table("Action", action)
    assert_rows_are(rows, env.action_space)
    assert [row["unit"] for row in rows] == ["m"] * 3 + ["rad"] * 3 + further
    rows = [row for number in observation for row in table("Observation", number)]
    assert {row["key"] for row in rows} == set(env.observation_space.spaces)
    for key, box in env.observation_space.spaces.items():
        assert_rows_are([row for row in rows if row["key"] == key], box)


def test_info_table_is_the_info(make_env):
    _, info = make_env().reset(seed=0)
    rows = {row["key"]: row for row in table("Info")}
    assert list(rows) == list(info)
    for key, value in info.items():
        shape = f"{value.shape} array" if isinstance(value, np.ndarray) else None
        assert rows[key]["type"] == (shape or type(value).__name__)
        assert rows[key]["unit"] == (INFO[key].unit or "-")
    _, most = bounds(rows["door_angle"]["range"])
    assert most == pytest.approx(DoorConfig().stop_angle, abs=1e-3)
    assert column("Reward", "term") == list(info["reward_terms"])


def assert_fields_are(rows: Rows, record: Any, key: str, rel: float) -> None:
    fields = [one for one in dataclasses.fields(record) if one.name not in PARTS]
    assert [row[key] for row in rows] == [field.name for field in fields]
    for row, field in zip(rows, fields, strict=True):
        if row["range"] == "-" or row["default"] == "None":
            assert row["default"] == str(field.default)
        else:
            assert float(row["default"]) == pytest.approx(field.default, rel=1e-5)
        if row["range"] != "-":
            allowed = allowed_range(record, field.name)
            assert row["unit"] == allowed.unit
            ends = max(allowed.low, allowed.above), allowed.high
            assert bounds(row["range"]) == pytest.approx(ends, rel=rel)
            assert (row["range"][0] == "(") == (allowed.above > allowed.low)


def test_door_tables_are_the_configuration_and_its_presets():
    rows = table("Door parameters")
    plain = [row for row in rows if "." not in row["parameter"]]
    assert_fields_are(plain, DoorConfig, "parameter", rel=1e-5)
    for part in PARTS:
        own = [row for row in rows if row["parameter"].startswith(f"{part}.")]
        for row in own:
            row["parameter"] = row["parameter"].removeprefix(f"{part}.")
        assert_fields_are(own, type(getattr(DoorConfig(), part)), "parameter", 1e-5)
    stated = {
        row.pop("preset"): DoorConfig(
            closer=Closer(preload=float(row.pop("closer.preload"))),
            **{k: float(v) for k, v in row.items()},
        )
        for row in table("Door parameters", 1)
    }
    described = ", ".join(column("Door parameters", "preset", 2)).split(", ")
    assert stated | {name: DOORS[name] for name in described} == dict(DOORS)


def test_disturbance_tables_are_the_records():
    rows = table("Disturbances")
    assert list(dict.fromkeys(row["cause"] for row in rows)) == list(CAUSES)
    for cause, record in CAUSES.items():
        own = [row for row in rows if row["cause"] == cause]
        assert_fields_are(own, record, "field", rel=1e-3)
    assert ["none", *column("Disturbances", "preset", 1)] == list(DISTURBANCES)


# --- Numbers, arguments, code --------------------------------------------------------
