"""The diffusion policy of the examples; needs the extra learners, run by .ci/learners.

Networks are trained for a moment here: what they learn is not judged.
"""

import importlib
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if os.environ.get("GPLFD_REQUIRE_ALL") != "1":
    pytest.importorskip("torch", reason="needs pip install '.[learners]'")

import torch

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import Demonstration
from gplfd_policies.registry.method import TrainingInput

EXAMPLES = Path(__file__).parents[2] / "examples"
sys.path.insert(0, str(EXAMPLES))
policy: Any = importlib.import_module("diffusion_policy")

RADIUS, RATE = 0.5, 0.2  # [m], [rad/s]
AHEAD = handle_pose_on_arc(RADIUS, RATE * np.linspace(0.1, 1.6, 16))


def test_chunks_of_an_even_arc_are_the_same_everywhere():
    """In the axes of the hand, a circle at constant speed looks alike at any angle."""
    times = np.arange(301) / 60.0
    poses = handle_pose_on_arc(RADIUS, RATE * times)
    states, chunks = policy.lessons([Demonstration(times=times, poses=poses)])
    assert states.shape == (301, 6)
    before_the_end = chunks[: 301 - 6 * policy.CHUNK].numpy()
    expected = np.broadcast_to(AHEAD.ravel(), before_the_end.shape)
    np.testing.assert_allclose(before_the_end, expected, atol=1e-6)
    np.testing.assert_allclose(chunks[-1], 0.0, atol=1e-6)


def test_denoising_from_zero_ends_at_the_most_probable_chunk():
    """Of normal chunks the best prediction of noise is known."""
    mean, std = torch.linspace(-0.3, 0.4, 6 * policy.CHUNK), 0.3

    class Known(policy.Denoiser):
        def forward(self, chunks: Any, states: Any, levels: Any) -> Any:
            signal = self.signal[levels, None]
            variance = signal * std**2 + 1.0 - signal
            return (1.0 - signal).sqrt() * (chunks - signal.sqrt() * mean) / variance

    network = Known()
    network.fit_scales(chunk=torch.stack([-2.0 * torch.ones(96), 4.0 * torch.ones(96)]))
    found = network.sample(np.zeros(6), torch.zeros(1, 96))
    np.testing.assert_allclose(found.ravel(), 1.0 + 3.0 * mean, atol=1e-3)


def test_commands_go_on_from_the_last_one_to_what_is_predicted():
    """On the arc all predictions agree, and the hand is where it was told to be."""

    class OnTheArc:
        asked = 0

        def sample(self, hand: Any, noise: Any) -> Any:
            self.asked += 1
            return AHEAD

    network = OnTheArc()
    agent, hand = policy.Diffusion(network, 0), np.zeros(6)
    agent.reset({"ee_pose": hand})
    for step in range(1, 201):
        command = agent.act({"ee_pose": hand})
        on_arc = handle_pose_on_arc(RADIUS, 0.01 * RATE * step)
        np.testing.assert_allclose(command, on_arc, atol=3e-5)
        hand = command
    assert network.asked == 20


def test_what_is_learned_depends_on_demonstrations_and_seed(monkeypatch):
    monkeypatch.setattr(policy, "STEPS", 20)
    shown = Teacher().standard_demonstrations(1, seed=0)
    first, again, seed, fewer = (
        policy.make(TrainingInput(demonstrations=given, seed=number))
        for given, number in ((shown, 0), (shown, 0), (shown, 1), (shown[:2], 0))
    )
    plan, *others = (
        each.network.sample(np.zeros(6), torch.zeros(1, 96))
        for each in (first, again, seed, fewer)
    )
    np.testing.assert_array_equal(plan, others[0])
    assert not any(np.allclose(plan, other) for other in others[1:])
