"""Demonstrations of several kinds without a label: partition, and an agent for them."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies import POLICIES, AlignedDemonstrations, TrainingInput, batch_agents
from gplfd_policies.agents.modes import ModeConfig, ModesAgent, ModesBatch
from gplfd_policies.demonstrations.aligned import WITHIN, partition

pytestmark = pytest.mark.slow

PUSHED = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])  # mirrored in x


def mirrored(demonstrations, signs):
    return [
        dataclasses.replace(motion, poses=motion.poses * signs)
        for motion in demonstrations
    ]


def partitions(numbers):
    if not numbers:
        yield ()
        return
    first, *others = numbers
    for size in range(len(others) + 1):
        for chosen in itertools.combinations(others, size):
            left = [n for n in others if n not in chosen]
            for more in partitions(left):
                yield ((first, *chosen), *more)


@pytest.mark.parametrize("seed", range(4))
def test_partition_has_the_least_criterion_of_all_partitions(seed):
    """Of the 203 partitions of six, for shapes that are one, two or three clusters."""
    rng = np.random.default_rng(seed)
    ways = rng.normal(size=(1 + seed % 3, 6))
    ways = ways[rng.integers(len(ways), size=6)] + 0.15 * rng.normal(size=(6, 6))
    phases = np.linspace(0.0, 1.0, 50)
    poses = phases[:, None] * ways[:, None, :]
    parts = partition(AlignedDemonstrations(times=phases, poses=poses))

    sizes = np.sqrt((poses.reshape(6, 50, 2, 3) ** 2).sum(axis=3).mean(axis=1))
    sizes[:, 1] = np.maximum(sizes[:, 1], sizes[:, 0] / 1.0)
    shapes = poses / np.repeat(sizes, 3, axis=1)[:, None, :]

    def criterion(modes):
        within = [shapes[list(m)] - shapes[list(m)].mean(axis=0) for m in modes]
        squares = sum((errors**2).sum(axis=2).mean(axis=1).sum() for errors in within)
        return squares / WITHIN**2 + len(modes) * math.log(6)

    best = min(partitions(range(6)), key=criterion)
    assert sorted(parts) == sorted(best)
    assert [len(m) for m in parts] == sorted((len(m) for m in parts), reverse=True)


@pytest.fixture(scope="module")
def modes(demonstrations):
    motions = [*demonstrations, *mirrored(demonstrations, PUSHED)]
    method = POLICIES["gp"].method
    return method.learn_modes(TrainingInput(demonstrations=motions))


@pytest.mark.parametrize("counts", [(1, 1), (5, 1), (3, 2)])
def test_modes_are_given_up_in_turn_at_forces_of_the_formula(modes, counts):
    """A hand that does not move: ½ (F_i² - F_j²) / b² = log(odds) + log(π_i / π_j)."""
    agents = [POLICIES["gp"].method.follow(mode.movement) for mode in modes]
    config = ModeConfig()
    agent = ModesAgent(agents, counts, config)
    agent.reset({"ee_pose": np.zeros(6), "wrench": np.zeros(6)})
    given_up, force, mode = [], 0.0, 0
    for _ in range(500):
        against = np.array([force if mode else -force, 0.0, 0.0, 0.0, 0.0, 0.0])
        step = agent.act({"ee_pose": np.zeros(6), "wrench": against})
        backs_off = step.mode_probability * (1.0 + config.odds) < 1.0
        if backs_off and force > 0.0:
            given_up.append(force)
        mode, force = int(step.mode), 0.0 if backs_off else force + 0.2
    expected = [0.0]
    for number in range(len(given_up)):
        ratio = math.log(counts[number % 2] / counts[1 - number % 2])
        added = 2.0 * config.load_scale**2 * (math.log(config.odds) + ratio)
        expected.append(math.sqrt(expected[-1] ** 2 + added))
    assert len(given_up) >= 2
    # A force has to last for three steps.
    assert_allclose(given_up, np.array(expected[1:]) + 0.4, atol=0.25)


def test_an_agent_that_may_act_differently_is_called_itself(modes):
    for kind in (ModesAgent, type("Own", (ModesAgent,), {})):
        agents = [POLICIES["gp"].method.follow(mode.movement) for mode in modes]
        batch = batch_agents([kind(agents, (1, 1))])
        assert isinstance(batch, ModesBatch) == (kind is ModesAgent)
