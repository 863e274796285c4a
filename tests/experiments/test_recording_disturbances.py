"""What a recording shows of what happens from outside."""

import numpy as np
import pytest

from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.parts import (
    KINDS,
    disturbance_chunks,
    events,
    kinds_of,
)
from gplfd_experiments.recording.stream import frames

SHIFT = 1e-4 * np.clip(np.arange(601.0) - 99.0, 0.0, 120.0)


def held(peak: float, first: int = 200, end: int = 450) -> np.ndarray:
    """A force that comes at once and fades."""
    rows = np.arange(601)
    inside = (rows >= first) & (rows < end)
    return np.where(inside, peak * (end - rows) / (end - first), 0.0)


@pytest.fixture
def shown(columns):
    return lambda log: columns(disturbance_chunks(log))


def test_the_curve_is_the_log_s(make_log, shown):
    chunks = shown(make_log(person_force=held(33.0)))
    curve = chunks["/plots/outside/person", "Scalars:scalars"][1]
    np.testing.assert_allclose(np.ravel(curve), held(33.0))
    assert not any("push" in entity for entity, _ in chunks)
    assert list(shown(make_log())) == []
    chunks = shown(make_log(base_shift=SHIFT))
    curve = chunks["/plots/outside/bump", "Scalars:scalars"][1]
    np.testing.assert_allclose(np.ravel(curve), 1e3 * SHIFT)  # mm


def test_a_ball_stands_above_the_hand_while_something_acts(make_log, shown):
    log = make_log(person_force=held(32.0))
    chunks, ball = shown(log), "/world/task/outside/person"
    rows = frames(log)
    labels = chunks[ball, "Points3D:labels"][1]
    acts = [bool(label) for label in labels]
    assert acts == (log.forces.person_force[rows] > 0.0).tolist()
    first = acts.index(True)
    assert labels[first] == [f"person {log.forces.person_force[rows[first]]:.0f} N"]
    place = chunks[ball, "Points3D:positions"][1][first][0]
    above = log.motion.ee_pose[rows[first], :3] + [0.0, 0.30, 0.0]
    np.testing.assert_allclose(place, above, atol=1e-6)
    # A quarter of the force is half the radius.
    radii = np.concatenate(chunks[ball, "Points3D:radii"][1])
    forces = log.forces.person_force[rows[acts]]
    np.testing.assert_allclose(radii / radii[0], np.sqrt(forces / forces[0]), rtol=1e-6)


def test_beginning_and_end_are_told(make_log, shown):
    log = make_log(person_force=held(33.0) + held(20.0, 500, 700))
    assert events(log, "person") == [
        (200, KINDS["person"].begins),
        (450, f"{KINDS['person'].ends}: 33 N at most"),
        (500, KINDS["person"].begins),
    ]
    assert shown(log)["/outside/log/person", "TextLog:text"][1][1] == [
        "the person lets go: 33 N at most"
    ]
    (_, _), (row, text) = events(make_log(base_shift=SHIFT), "bump")
    assert (row, text) == (220, "the base stops: 12 mm at most")


@pytest.mark.parametrize(
    ("peak", "limits"), [(33.0, []), (69.0, []), (70.0, [140]), (150.0, [140, 280])]
)
def test_limits_are_drawn_only_near_them(make_log, peak, limits, shown):
    chunks = shown(make_log(person_force=held(peak)))
    drawn = [
        entity.rpartition("_")[2]
        for entity, component in chunks
        if "allowed" in entity and component == "Scalars:scalars"
    ]
    assert [int(limit) for limit in drawn] == limits


def test_the_layout_has_room_only_for_what_happens(make_log, titles_of):
    plain, disturbed = (
        titles_of(layout(kinds_of(log)))
        for log in (make_log(), make_log(person_force=held(33.0)))
    )
    assert set(disturbed) - set(plain) == {"From outside: person [N]", "From outside"}
    assert len(plain) == 17
