"""One contract of all parts of the controller: a row of a batch is as if alone."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gplfd_policies.arrays.rows import ALL_ROWS, rows_of
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.contact import HELD_HAND
from gplfd_policies.control.load import (
    CarriedLoad,
    ContactState,
    LearnedLoad,
    YieldToAll,
)
from gplfd_policies.control.rendering import (
    ARM_DYNAMICS,
    ArmRendering,
    VirtualRendering,
)
from gplfd_policies.control.stability import StiffnessGovernor
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, DEFAULT_PROFILE
from gplfd_policies.demonstrations.turned_handle import TurnedHandle
from gplfd_policies.handles.adapter import HandleCompensation, HandleConfig, HandleLoad

N, DT = 5, 0.01
LEVER = TurnedHandle(point=(0.0, 0.0, 0.1), axis=(-1.0, 0.0, 0.0), travel=0.8)

Step = Callable[..., tuple[Any, ...]]
"""Arrays of some rows, by name, and the rows; returns what comes of them."""


def inputs(rng: np.random.Generator) -> dict[str, np.ndarray]:
    directions = rng.normal(size=(N, 3))
    return {
        "wrench": 15.0 * rng.normal(size=(N, 6)),
        "direction": directions / np.linalg.norm(directions, axis=1, keepdims=True),
        "pose": 0.02 * rng.normal(size=(N, 6)),
        "displacement": 0.02 * rng.normal(size=(N, 3)),
        "stiffness": rng.uniform(0.2, 1.0, (N, 6)) * DEFAULT_PROFILE.k_max,
    }


def admittance(shape: tuple[int, ...]) -> tuple[Any, Step]:
    part = Admittance(DEFAULT_DYNAMICS, shape)

    def step(values: dict[str, Any], rows: Any = ALL_ROWS) -> tuple[Any, ...]:
        found = part.step(values["stiffness"], values["wrench"], DT, rows)
        return found, part.velocity[rows]

    return part, step


def governor(shape: tuple[int, ...]) -> tuple[Any, Step]:
    part = StiffnessGovernor(DEFAULT_PROFILE, DEFAULT_DYNAMICS, shape)

    def step(values: dict[str, Any], rows: Any = ALL_ROWS) -> tuple[Any, ...]:
        found = part.step(values["stiffness"], DT, rows)
        return found.stiffness, found.rate, found.margin

    return part, step


def load(part: Any) -> tuple[Any, Step]:
    def step(values: dict[str, Any], rows: Any = ALL_ROWS) -> tuple[Any, ...]:
        fields = ("wrench", "direction", "pose", "displacement")
        contact = ContactState(**{name: values[name] for name in fields})
        found = part.update(contact, rows)
        return (
            found.compliant_wrench,
            found.compensated_load,
            found.pace,
            found.path_lag,
        )

    return part, step


def handle_load(shape: tuple[int, ...]) -> tuple[Any, Step]:
    handles = HandleCompensation([LEVER] * (shape or (1,))[0], shape, HandleConfig())
    return load(HandleLoad(LearnedLoad(), DEFAULT_PROFILE, handles, shape, DT))


def renderer(rendering: Any, shape: tuple[int, ...]) -> tuple[Any, Step]:
    part = rendering.renderer(ARM_DYNAMICS, DT, shape)

    def step(values: dict[str, Any], rows: Any = ALL_ROWS) -> tuple[Any, ...]:
        action = part.step(
            values["pose"],
            values["direction"],
            values["stiffness"],
            compliant_wrench=values["wrench"],
            compensated_force=values["displacement"],
            rows=rows,
        )
        margin = part.contact_margin(values["stiffness"])
        return action, margin, part.displacement(values["pose"][..., :3], rows)

    return part, step


PARTS = {
    "admittance": admittance,
    "governor": governor,
    "learned load": lambda shape: load(LearnedLoad().begin(DEFAULT_PROFILE, shape)),
    "carried load": lambda shape: load(CarriedLoad().begin(DEFAULT_PROFILE, shape)),
    "yield to all": lambda shape: load(YieldToAll().begin(DEFAULT_PROFILE, shape)),
    "handle load": handle_load,
    "virtual rendering": lambda shape: renderer(VirtualRendering(), shape),
    "arm rendering": lambda shape: renderer(ArmRendering(), shape),
}


@pytest.mark.bits
@pytest.mark.parametrize("name", PARTS)
def test_a_row_of_a_batch_is_as_if_alone(name: str) -> None:
    """Rows are left out and reset at different times; the others go on."""
    rng = np.random.default_rng(0)
    part, together = PARTS[name]((N,))
    alone = [PARTS[name](()) for _ in range(N)]
    for time in range(25):
        if time in (5, 20):
            part.reset(np.array([1, 3]))
            alone[1][0].reset()
            alone[3][0].reset()
        values = inputs(rng)
        rows = np.flatnonzero(rng.random(N) < 0.7)
        found = together({key: each[rows] for key, each in values.items()}, rows)
        for index, row in enumerate(rows):
            # Copies: alone, an array begins where memory does.
            own = {key: each[row].copy() for key, each in values.items()}
            for batch, single in zip(found, alone[row][1](own), strict=True):
                np.testing.assert_array_equal(batch[index], single)


@pytest.mark.parametrize("name", PARTS)
def test_a_reset_forgets_everything(name: str) -> None:
    part, step = PARTS[name](())
    first = {key: each[0] for key, each in inputs(np.random.default_rng(1)).items()}
    expected = [np.copy(each) for each in step(first)]
    rng = np.random.default_rng(2)
    for _ in range(5):
        step({key: each[0] for key, each in inputs(rng).items()})
    part.reset()
    for found, before in zip(step(first), expected, strict=True):
        np.testing.assert_array_equal(found, before)


@pytest.mark.parametrize("name", PARTS)
def test_results_may_be_changed(name: str) -> None:
    """And nothing that was given has been."""
    one, other = (PARTS[name](())[1] for _ in range(2))
    rng = np.random.default_rng(3)
    for _ in range(3):
        values = {key: each[0] for key, each in inputs(rng).items()}
        kept = {key: each.copy() for key, each in values.items()}
        for changed, expected in zip(one(values), other(kept), strict=True):
            np.testing.assert_array_equal(changed, expected)
            if isinstance(changed, np.ndarray) and name != "yield to all":
                changed[...] = 9.0
        for key, each in values.items():
            np.testing.assert_array_equal(each, kept[key])


@pytest.mark.bits
def test_margins_do_not_depend_on_the_memory_layout() -> None:
    rng = np.random.default_rng(0)
    stiffness, damping = rng.uniform(1.0, 500.0, (2, N, 6))
    packed = HELD_HAND.margin(stiffness, damping, DEFAULT_DYNAMICS.mass)
    strided = np.asfortranarray(stiffness)
    found = HELD_HAND.margin(strided, damping, DEFAULT_DYNAMICS.mass)
    np.testing.assert_array_equal(found, packed)


def test_a_mask_selects_rows() -> None:
    assert rows_of(None, 3) == rows_of(np.ones(3, bool), 3) == ALL_ROWS
    np.testing.assert_array_equal(rows_of(np.array([True, False, True]), 3), [0, 2])
    for wrong in (np.ones(3), np.ones(2, bool), np.array([True])):
        with pytest.raises(ValueError, match=r"boolean of shape \(3,\)"):
            rows_of(wrong, 3)


@pytest.mark.parametrize("dt", [0.0, -0.01, np.nan])
@pytest.mark.parametrize("name", ["admittance", "governor"])
def test_a_period_that_is_not_positive_is_refused(name: str, dt: float) -> None:
    part, _ = PARTS[name](())
    arrays = (np.full(6, 100.0), np.zeros(6))[: 2 if name == "admittance" else 1]
    with pytest.raises(ValueError, match="dt must be positive"):
        part.step(*arrays, dt)


def test_rows_that_did_not_act_keep_their_action() -> None:
    actions = np.arange(18.0).reshape(3, 6)
    some = AgentStep(action=-actions[:2], phase=np.array([0.1, 0.2]))
    everyone = some.among(np.array([0, 2]), actions)
    np.testing.assert_array_equal(
        everyone.action, [-actions[0], actions[1], -actions[1]]
    )
    np.testing.assert_array_equal(everyone.phase, [0.1, np.nan, 0.2])
    assert some.among(ALL_ROWS, actions) is some
