"""One contract of all parts of the controller: a row of a batch is as if alone."""

import functools
from dataclasses import fields, replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import Demonstration, align
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.handles import HandleConfig, HandleLoad, HandleMovements
from gplfd_policies.arrays.rows import ALL_ROWS, rows_of
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.expected_force import ExpectedForce
from gplfd_policies.control.frame import directional_std, path_frame
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
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, DEFAULT_PROFILE
from gplfd_policies.demonstrations.turned_handle import TurnedHandle
from gplfd_policies.movements.baselines.dmp import fit_dmp

N, DT = 5, 0.01
LEVER = TurnedHandle(point=(0.0, 0.0, 0.1), axis=(-1.0, 0.0, 0.0), travel=0.8)


def inputs(rng):
    directions = rng.normal(size=(N, 3))
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return {
        "wrench": 15.0 * rng.normal(size=(N, 6)),
        "direction": unit,
        "pose": 0.02 * rng.normal(size=(N, 6)),
        "displacement": 0.02 * rng.normal(size=(N, 3)),
        "frame": path_frame(unit),
        "force": 20.0 * rng.normal(size=(N, 3)),
        "force_std": rng.uniform(0.5, 5.0, (N, 3)),
        "stiffness": rng.uniform(0.2, 1.0, (N, 6)) * DEFAULT_PROFILE.k_max,
    }


@functools.cache
def movement():
    phases = np.linspace(0.0, 1.0, 50)
    motion = Demonstration(times=phases, poses=np.outer(phases, np.ones(6)))
    return fit_dmp(align([motion] * 2))


def handle_load(shape):
    count = (shape or (1,))[0]
    gridded = [GriddedMovement(movement(), None, 10) for _ in range(count)]
    movements = HandleMovements(
        gridded if shape else gridded[0], [LEVER] * count, HandleConfig()
    )
    return HandleLoad(LearnedLoad(), DEFAULT_PROFILE, movements, DT)


def admitted(part, given, rows):
    found = part.step(given["stiffness"], given["wrench"], DT, rows)
    return found, part.velocity[rows]


def governed(part, given, rows):
    found = part.step(given["stiffness"], DT, rows)
    return tuple(getattr(found, one.name) for one in fields(found))


def in_frames(part, given, rows):
    frame = given["frame"]
    pose = given["pose"]
    std = directional_std(frame, np.abs(pose), 0.5 * pose[..., 0] * pose[..., 2])
    wished = DEFAULT_PROFILE.stiffness(std, frame)
    if isinstance(part, Admittance):
        return part.step(wished, given["wrench"], DT, rows, frame), part.velocity[rows]
    found = part.step(wished, DT, rows, frame)
    return tuple(getattr(found, one.name) for one in fields(found))


def loaded(part, given, rows):
    names = ("wrench", "direction", "pose", "displacement")
    expected = ExpectedForce(
        mean=given["force"], std=given["force_std"], axes=given["frame"]
    )
    contact = ContactState(
        **{name: given[name] for name in names},
        expected=expected,
        expected_ahead=replace(expected, mean=given["displacement"]),
    )
    found = part.update(contact, rows)
    return tuple(getattr(found, one.name) for one in fields(found))


def rendered(part, given, rows):
    displaced = part.displacement(given["pose"][..., :3], rows)
    action = part.step(
        given["pose"],
        given["direction"],
        given["stiffness"],
        compliant_wrench=given["wrench"],
        compensated_force=given["displacement"],
        rows=rows,
    )
    margin = part.contact_margin(given["stiffness"])
    return action, margin, displaced


MAKE = {
    "admittance": lambda shape: Admittance(DEFAULT_DYNAMICS, shape),
    "governor": lambda shape: StiffnessGovernor(
        DEFAULT_PROFILE, DEFAULT_DYNAMICS, shape
    ),
    "learned load": lambda shape: LearnedLoad().begin(DEFAULT_PROFILE, shape),
    "carried load": lambda shape: CarriedLoad().begin(DEFAULT_PROFILE, shape),
    "yield to all": lambda shape: YieldToAll().begin(DEFAULT_PROFILE, shape),
    "handle load": handle_load,
    "virtual rendering": lambda shape: VirtualRendering().renderer(
        DEFAULT_DYNAMICS, DT, shape
    ),
    "arm rendering": lambda shape: ArmRendering().renderer(ARM_DYNAMICS, DT, shape),
}
MAKE |= {f"{name} in frames": MAKE[name] for name in ("admittance", "governor")}
STEPS = {
    **{name: loaded if "load" in name else rendered for name in MAKE},
    "admittance": admitted,
    "governor": governed,
    "admittance in frames": in_frames,
    "governor in frames": in_frames,
    "yield to all": loaded,
}


def row_of(values, row):
    # Copies: alone, an array begins where memory does.
    return {name: each[row].copy() for name, each in values.items()}


@pytest.mark.bits
@pytest.mark.parametrize("name", MAKE)
def test_a_row_of_a_batch_is_as_if_alone(name):
    """Rows are left out and reset at different times; the others go on."""
    rng = np.random.default_rng(0)
    together, alone = MAKE[name]((N,)), [MAKE[name](()) for _ in range(N)]
    for time in range(25):
        if time in (5, 20):
            together.reset(np.array([1, 3]))
            alone[1].reset()
            alone[3].reset()
        values, rows = inputs(rng), np.flatnonzero(rng.random(N) < 0.7)
        found = STEPS[name](together, row_of(values, rows), rows)
        for index, row in enumerate(rows):
            own = STEPS[name](alone[row], row_of(values, row), ALL_ROWS)
            for batch, single in zip(found, own, strict=True):
                assert_array_equal(batch[index], single)


def test_a_mask_selects_rows():
    assert rows_of(None, 3) == rows_of(np.ones(3, bool), 3) == ALL_ROWS
    assert_array_equal(rows_of(np.array([True, False, True]), 3), [0, 2])
    for wrong in (np.ones(3), np.ones(2, bool), np.array([True])):
        with pytest.raises(ValueError, match=r"boolean of shape \(3,\)"):
            rows_of(wrong, 3)
