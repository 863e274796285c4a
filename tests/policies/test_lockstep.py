"""Agents in lockstep decide bit for bit as they would alone."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher import ForceConfig, Teacher
from gplfd_policies import POLICIES, AgentStep, TrainingInput, make_agent, policy_named
from gplfd_policies.agents.agent import CompliantAgent, batch_agents
from gplfd_policies.agents.modes import ModesAgent
from gplfd_policies.arrays.rows import ALL_ROWS, rows_of
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.registry.built_in import PARTS, PUBLISHED

pytestmark = pytest.mark.slow

PUSHED = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])  # mirrored in x
RADII = (0.38, 0.50, 0.62)
LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
FIELDS = [field.name for field in fields(AgentStep)]


def way_to_follow(name, policy):
    """What tells how a policy follows a movement, but for the noise of via-points."""
    method = policy.method
    if method is None:
        return name
    pipeline = method.pipeline
    fitted = name.partition("@")[0] in ("promp", "tp-gmm", "kmp", "gmm-gp", "prodmp")
    own = method.learner.adaptation or fitted
    form = pipeline.adapts and (pipeline.size_inference or own)
    config = replace(pipeline.config, via_std=ComplianceConfig().via_std)
    return getattr(form, "func", form), pipeline.phases, repr(config)


NAMES = [*POLICIES, *(f"gp@{part}" for part in PARTS)]
NAMES += [f"{name}@published" for name in PUBLISHED]
WAYS_TO_FOLLOW = {
    way_to_follow(name, policy_named(name)): name for name in reversed(NAMES)
}.values()
"""One policy of every way to follow a movement; the others learn differently."""


@pytest.fixture(scope="module")
def agents_of(demonstrations, learned):
    """One agent per door, by name; learned once: a reset makes them as new.

    ``"levers"`` are those of ``"gp"`` that were taught to turn a handle, with forces.
    """

    @cache
    def make(name):
        lessons = demonstrations, demonstrations[:4]
        if name == "levers":
            name, teacher = "gp", Teacher(forces=ForceConfig())
            lessons = [
                teacher.standard_demonstrations(1, seed=seed, like=LEVER)
                for seed in (0, 1)
            ]
        method = policy_named(name.removesuffix(" of modes")).method
        if method is None:
            agents = [make_agent(name, lessons[0]) for _ in RADII]
        elif name == "gp of modes":  # that pull, or push
            pushes = [replace(one, poses=one.poses * PUSHED) for one in demonstrations]
            both = TrainingInput(demonstrations=[*demonstrations, *pushes])
            modes = method.learn_modes(both)
            agents = [method.follow_modes(modes) for _ in RADII]
        else:
            movements = [learned(method, lessons[number]) for number in (1, 0, 1)]
            agents = [method.follow(movement) for movement in movements]
            # Each has the stiffness law of its own demonstrations; what these say of
            # stiffness by phase must be equal for those that act at once.
            alike = {"phase_stiffness": agents[0].config.phase_stiffness}
            agents = [replace(a, config=replace(a.config, **alike)) for a in agents]
        for agent, radius in zip(agents, RADII, strict=True):
            agent.inform(DoorGeometry.of(DoorConfig(radius=radius)))
        return agents

    return make


class Doors:
    """Doors that are opened step by step, whatever is commanded, and pull and shake.

    A handle is turned first, meanwhile the doors hold the hands back.
    """

    def __init__(self, geometries):
        self.geometries, self.rng = geometries, np.random.default_rng(0)
        self.angles, self.turned = np.zeros(len(geometries)), 0.0

    def observe(self):
        self.turned = min(self.turned + 0.1, 1.0)
        poses = [
            door.hand_poses(angle, 1.1 * self.turned * door.travel)
            for door, angle in zip(self.geometries, self.angles, strict=True)
        ]
        shape = (len(self.geometries), 6)
        wrenches = self.rng.normal(size=shape) * [9.0, 3.0, 3.0, 0.1, 0.1, 0.1]
        wrenches[:, 0] -= 15.0 * (self.geometries is not BARS)
        return {
            "ee_pose": np.array(poses) + 1e-4 * self.rng.normal(size=shape),
            "wrench": wrenches,
        }


BARS = [DoorGeometry.of(DoorConfig(radius=radius)) for radius in RADII]
LEVERS = [DoorGeometry.of(LEVER)] * 3
DOORS = {"levers": (LEVERS, 20, 20, 32), "gp of modes": ([*BARS], 140, 70, 140)}


def row_of(observations, row):
    return {name: rows[row] for name, rows in observations.items()}


def steps_of(batch, active, geometries, held, closing, end):
    """Open doors with a batch; return observations, steps and who acted, by time."""
    doors, history = Doors(geometries), []
    for time in range(end):
        doors.angles[1] *= time != closing
        observations, acting = doors.observe(), active(time)
        if time in (0, closing):
            batch.reset(observations, np.arange(3) == 1 if time else None)
        steps = batch.act(observations, None if acting.all() else acting)
        history.append((observations, steps, acting))
        doors.angles += 0.009 * acting * (time > held)
    return history


@pytest.mark.bits
@pytest.mark.parametrize("name", [*WAYS_TO_FOLLOW, "levers", "gp of modes"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_rows_of_a_batch_are_the_steps_of_its_agents(name, agents_of):
    """Row 0 ends early; 1 pauses and then begins anew; 2 starts late and goes on."""

    def active(time):
        return np.array([time < 14, not 16 < time < 20, time > 0])

    batch = batch_agents(agents_of(name))
    kinds = {CompliantAgent: "_VectorisedBatch", ModesAgent: "ModesBatch"}
    assert type(batch).__name__ == kinds.get(type(agents_of(name)[0]), "AgentBatch")
    geometries, held, closing, end = DOORS.get(name, (BARS, -1, 20, 32))
    history = steps_of(batch, active, geometries, held, closing, end)
    if name == "gp":
        laws = {agent.config.profile.beta.tobytes() for agent in agents_of(name)}
        assert len(laws) == 2
        assert np.sum([steps.via_point for _, steps, _ in history], axis=0).min() > 3
    if name == "gp of modes":  # The second went back and pushed, before and after.
        assert [history[time][1].mode[1] for time in (69, 71, -1)] == [1.0, 0.0, 1.0]
    forecasts = [batch.forecast(row) for row in range(3)]
    for row, agent in enumerate(agents_of(name)):
        agent.reset(row_of(history[0][0], row))
        for time, (observations, steps, acting) in enumerate(history):
            if time == closing and row == 1:
                agent.reset(row_of(observations, row))
            if not acting[row]:
                continue
            step = agent.act(row_of(observations, row))
            for name in FIELDS:
                value, expected = getattr(steps, name)[row], getattr(step, name)
                assert_array_equal(value, expected, err_msg=name)
        expected = agent.forecast()
        assert (forecasts[row] is None) == (expected is None)
        if expected is not None:
            assert_array_equal(forecasts[row].mean, expected.mean)
            assert_array_equal(forecasts[row].std, expected.std)


def test_a_mask_selects_rows():
    assert rows_of(None, 3) == rows_of(np.ones(3, bool), 3) == ALL_ROWS
    assert_array_equal(rows_of(np.array([True, False, True]), 3), [0, 2])
    for wrong in (np.ones(3), np.ones(2, bool)):
        with pytest.raises(ValueError, match=r"boolean of shape \(3,\)"):
            rows_of(wrong, 3)
