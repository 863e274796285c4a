"""Ranges that every episode draws from: presets, draws, and every wrong one."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.randomization import (
    RANDOMIZATIONS,
    DoorRandomization,
    door_randomization,
)

# Field: the widest range allowed, stated by hand; None where it replaces nothing.
DOOR_FIELDS = {
    "radius": (0.30, 0.95),
    "hinge_friction": (0.0, 50.0),
    "hinge_damping": (0.0, 50.0),
    "closer_stiffness": (0.0, 50.0),
    "closer_preload": (0.0, 50.0),
    "panel_mass": (1.0, 100.0),
    "handle_height": (0.50, 1.22),
}
WIDTHS = {
    "base_position": 0.05,
    "base_yaw": 0.1,
    "grasp_height": 0.05,
    "grasp_depth": 0.008,
}
NOISES = {"pose_noise": (0.01, 0.1), "wrench_noise": (10.0, 1.0)}

pairs = st.fixed_dictionaries(
    {},
    optional={
        name: st.tuples(st.floats(*span), st.floats(*span)).map(
            lambda pair: tuple(sorted(pair))
        )
        for name, span in DOOR_FIELDS.items()
    }
    | {name: st.floats(0.0, width) for name, width in WIDTHS.items()}
    | {"longest_delay": st.integers(0, 10)},
)
seeds = st.integers(0, 2**32 - 1)


@given(fields=pairs, seed=seeds)
def test_draws_stay_within_their_ranges(fields: dict[str, Any], seed: int) -> None:
    randomization = DoorRandomization(**fields)
    door = DoorConfig(radius=0.42, panel_mass=7.0, handle_standoff=0.09)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        drawn = randomization.sample(door, rng)
        for name in DOOR_FIELDS:
            own = getattr(door, name)
            low, high = fields.get(name, (own, own))
            assert low <= getattr(drawn.door, name) <= high
        assert drawn.door.handle_standoff == 0.09, "never varied"
        place = drawn.placement
        for name in ("base_yaw", "grasp_height", "grasp_depth"):
            assert abs(getattr(place, name)) <= fields.get(name, 0.0)
        assert max(abs(place.base_x), abs(place.base_y)) <= fields.get(
            "base_position", 0.0
        )
        assert 0 <= drawn.delay <= fields.get("longest_delay", 0)


@given(fields=pairs, other=pairs, seed=seeds)
def test_a_range_changes_the_draws_of_no_other(
    fields: dict[str, Any], other: dict[str, Any], seed: int
) -> None:
    """Of two randomisations, what has the same range in both is drawn the same."""
    door = DoorConfig()
    first, second = (
        DoorRandomization(**each).sample(door, np.random.default_rng(seed)).as_dict()
        for each in (fields, other)
    )
    drawn_as = {"base_position": ("base_x", "base_y"), "longest_delay": ("delay",)}
    for name in (*DOOR_FIELDS, *WIDTHS, "longest_delay"):
        if fields.get(name) == other.get(name):
            for value in drawn_as.get(name, (name,)):
                assert first[value] == second[value], value


def test_draws_are_uniform_and_independent() -> None:
    """Mean, variance and all correlations, within about 4 standard errors."""
    widest = DoorRandomization(**DOOR_FIELDS, **WIDTHS, longest_delay=10)
    rng, n = np.random.default_rng(0), 4000
    rows = [widest.sample(DoorConfig(), rng).as_dict() for _ in range(n)]
    spans = DOOR_FIELDS | {name: (-width, width) for name, width in WIDTHS.items()}
    spans["base_x"] = spans["base_y"] = spans.pop("base_position")
    spans["delay"] = (-0.5, 10.5)
    drawn = np.array([[row[name] for name in spans] for row in rows])
    low, high = np.array(list(spans.values())).T
    unit = (drawn - low) / (high - low)
    assert np.abs(unit.mean(axis=0) - 0.5).max() < 4 * math.sqrt(1 / 12 / n)
    assert np.abs(unit.var(axis=0) * 12 - 1.0).max() < 0.05
    correlation = np.corrcoef(unit.T) - np.eye(len(spans))
    assert np.abs(correlation).max() < 4 / math.sqrt(n)
    assert {row["delay"] for row in rows} == set(range(11))


def test_a_delay_can_be_pinned() -> None:
    for shortest, longest in ((3, 3), (2, 4)):
        pinned = DoorRandomization(shortest_delay=shortest, longest_delay=longest)
        rng = np.random.default_rng(0)
        delays = {pinned.sample(DoorConfig(), rng).delay for _ in range(200)}
        assert delays == set(range(shortest, longest + 1))
    with pytest.raises(ValueError, match="shortest_delay = 3 must not be above"):
        DoorRandomization(shortest_delay=3, longest_delay=2)


def test_presets() -> None:
    assert list(RANDOMIZATIONS) == ["none", "mild", "hard", "standard"]
    assert RANDOMIZATIONS["none"] == DoorRandomization()
    assert RANDOMIZATIONS["none"].idle
    mild, hard = RANDOMIZATIONS["mild"], RANDOMIZATIONS["hard"]
    assert not mild.idle
    # Mild keeps the radius, the quantity that is learned about; hard is wider in all.
    assert mild.radius is None
    for name in DOOR_FIELDS:
        narrow, wide = getattr(mild, name), getattr(hard, name)
        assert wide is not None
        assert narrow is None or (wide[0] <= narrow[0] and narrow[1] <= wide[1])
    for name in (*WIDTHS, "longest_delay", *NOISES):
        assert np.all(np.less(getattr(mild, name), getattr(hard, name)))
    with pytest.raises(TypeError):
        RANDOMIZATIONS["mild"] = DoorRandomization()  # type: ignore[index]


def test_names_mappings_and_records() -> None:
    hard = RANDOMIZATIONS["hard"]
    assert door_randomization("hard") is hard
    assert door_randomization(hard) is hard
    assert door_randomization({}) == RANDOMIZATIONS["none"]
    assert door_randomization({"preset": "hard"}) == hard
    assert door_randomization(dataclasses.asdict(hard)) == hard
    mapping = {"preset": "hard", "radius": [0.4, 0.5], "base_yaw": 0}
    changed = door_randomization(mapping)
    assert changed == dataclasses.replace(hard, radius=(0.4, 0.5), base_yaw=0.0)
    assert type(changed.radius) is tuple, "lists, as JSON has them, become pairs"
    assert mapping == {"preset": "hard", "radius": [0.4, 0.5], "base_yaw": 0}
    assert hash(changed) == hash(door_randomization(mapping))


@pytest.mark.parametrize("field", DOOR_FIELDS)
def test_widest_range_of_each_door_field(field: str) -> None:
    low, high = DOOR_FIELDS[field]
    assert getattr(DoorRandomization(**{field: (low, high)}), field) == (low, high)
    for wrong in ((low - 0.01, high), (low, high + 0.01)):
        with pytest.raises(
            ValueError, match=rf"Randomization\.{field} = .* is outside"
        ):
            DoorRandomization(**{field: wrong})
    with pytest.raises(ValueError, match=rf"Randomization\.{field} = .*low <= high"):
        DoorRandomization(**{field: (high, low)})


@pytest.mark.parametrize("field", WIDTHS)
def test_widest_placement(field: str) -> None:
    assert getattr(DoorRandomization(**{field: WIDTHS[field]}), field) == WIDTHS[field]
    with pytest.raises(ValueError, match=rf"Randomization\.{field} = .* is outside \["):
        DoorRandomization(**{field: 1.01 * WIDTHS[field]})


def r(**fields: Any) -> Callable[[], Any]:
    return lambda: door_randomization(fields)


@pytest.mark.parametrize(
    ("make", "kind", "parts"),
    [
        (
            lambda: door_randomization("mid"),
            ValueError,
            ["unknown randomization 'mid' (did you mean 'mild'?)", "none, mild, hard"],
        ),
        (r(preset=3), ValueError, ["unknown randomization 3;"]),
        (
            r(hinge_fricton=(0, 1)),
            ValueError,
            ["'hinge_fricton' (did you mean 'hinge_friction'?)", "fields: radius, "],
        ),
        (lambda: door_randomization(3), TypeError, ["randomization must", "3 (int)"]),
        (lambda: door_randomization(None), TypeError, ["None (NoneType)"]),  # type: ignore[arg-type]
        (r(radius=0.4), ValueError, [".radius = 0.4 must be a pair of numbers"]),
        (r(radius="45"), TypeError, [".radius must be a number, got '4' (str)"]),
        (r(radius=("0.4", 0.5)), TypeError, ["must be a number, got '0.4' (str)"]),
        (r(radius=(0.4, 0.5, 0.6)), ValueError, ["must be a pair of numbers"]),
        (
            r(radius=(math.nan, 0.5)),
            ValueError,
            [".radius = nan is outside [0.3, 0.95] m"],
        ),
        (r(pose_noise=0.1), ValueError, [".pose_noise = 0.1 must be a pair"]),
        (r(wrench_noise=None), ValueError, [".wrench_noise = None must be a pair"]),
        (
            r(pose_noise=(0.0, 0.2)),
            ValueError,
            ["pose_noise = 0.2 is outside [0, 0.1] rad"],
        ),
        (
            r(base_yaw=-0.1),
            ValueError,
            [".base_yaw = -0.1 is outside [0, 0.1] rad"],
        ),
        (r(base_yaw=math.inf), ValueError, [".base_yaw = inf is outside [0, 0.1]"]),
        (r(grasp_height="x"), TypeError, [".grasp_height must be a number, got 'x'"]),
        (r(longest_delay=11), ValueError, [".longest_delay = 11", "from 0 to 10"]),
        (r(longest_delay=-1), ValueError, ["DoorRandomization.longest_delay = -1"]),
        (r(longest_delay=1.5), ValueError, [".longest_delay = 1.5 must be a whole"]),
        (r(longest_delay="3"), ValueError, [".longest_delay = '3' must be a whole"]),
        (r(longest_delay=True), ValueError, [".longest_delay = True must be a whole"]),
    ],
)
def test_wrong_ones_are_told_what_is_allowed(
    make: Callable[[], Any], kind: type[Exception], parts: list[str]
) -> None:
    with pytest.raises(kind) as error:
        make()
    for part in parts:
        assert part in str(error.value)


def test_fields_are_covered_by_this_file() -> None:
    known = {field.name for field in dataclasses.fields(DoorRandomization)}
    assert known == {
        *(*DOOR_FIELDS, *WIDTHS, *NOISES, "shortest_delay", "longest_delay", "doors")
    }
