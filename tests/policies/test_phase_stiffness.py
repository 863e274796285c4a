"""Stiffness from demonstrated forces, and what hands make of it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env.spatial.se3 import into_axes
from gplfd_policies import make_agent
from gplfd_policies.control.stiffness import PhaseStiffness

LAW = np.repeat([250.0, 25.0], 3)


@pytest.mark.parametrize(("share", "expected"), [(0.0, 250), (0.5, 200), (1.0, 160)])
def test_learned_stiffness_and_law_are_combined_by_their_logarithms(share, expected):
    """Learned are 160 N/m and 16 N m/rad at every phase."""
    learned = PhaseStiffness(
        stiffness=np.tile(np.repeat([160.0, 16.0], 3), (5, 1)),
        share=np.full((5, 6), share),
        direction=np.full((5, 3), np.nan),
    )
    combined = learned.combined(LAW, np.float64(0.3))
    assert_allclose(combined, expected * np.repeat([1.0, 0.1], 3), rtol=1e-12)
    assert share > 0.0 or np.array_equal(combined, LAW)


def pulled(demonstrations, force):
    """The same motions with a constant force in the axes of the hand [N]."""
    return [
        replace(
            motion,
            wrenches=np.pad(into_axes(-motion.poses[:, 3:], forces), ((0, 0), (0, 3))),
        )
        for motion in demonstrations
        for forces in [np.broadcast_to(force, (200, 3))]
    ]


@pytest.mark.parametrize(("newtons", "k"), [(0.4, 500), (2.75, 300), (20.0, 100)])
def test_stiffness_from_force_is_low_along_the_force_alone(newtons, k, demonstrations):
    force = newtons * np.array([0.6, 0.0, 0.8])
    agent = make_agent("gp@stiffness-from-force", pulled(demonstrations, force))
    observation = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(observation)
    step = agent.act(observation)
    matrix = step.frame @ np.diag(step.stiffness[:3]) @ step.frame.T
    across = np.eye(3) - np.outer(force, force) / newtons**2
    expected = 500.0 * across + k * (np.eye(3) - across)
    # The first phase is a period ahead of the closed door, where the hand has turned.
    assert_allclose(matrix, expected, atol=5.0)
    assert_allclose(step.stiffness[3:], 50.0)
    # The force turns with the hand.
    pose = agent.movement.learned.predict(np.array([0.5])).mean[0]
    along = agent.config.phase_stiffness.direction[50]
    turned = into_axes(-pose[3:], force / newtons)
    assert np.isnan(along).all() if k == 500 else np.allclose(along, turned, atol=0.02)


def test_stiffness_from_force_refuses_demonstrations_without(demonstrations):
    with pytest.raises(ValueError, match=r"with wrenches, got none; .* such as gp"):
        make_agent("gp@stiffness-from-force", demonstrations)


def test_learned_stiffness_is_that_of_the_commanded_phase(demonstrations, monkeypatch):
    """The hand is held at the closed door, and the command goes on."""
    asked = []

    def noted(self, stiffness, phase):
        asked.append(float(phase))
        return stiffness

    monkeypatch.setattr(PhaseStiffness, "combined", noted)
    agent = make_agent(
        "gp@stiffness-from-force", pulled(demonstrations, [3.0, 0.0, 1.0])
    )
    held = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(held)
    steps = [agent.act(held) for _ in range(20)]
    assert asked == [step.phase for step in steps]
    assert steps[-1].phase > steps[-1].observed_phase + 0.01
