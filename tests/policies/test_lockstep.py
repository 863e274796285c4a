"""Agents in lockstep decide bit for bit as they would alone."""

import copy
import dataclasses
from functools import cache, partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gplfd_env import DoorGeometry
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_policies import POLICIES, TrainingInput, fit_skill, make_agent
from gplfd_policies.agents.lockstep import AgentBatch, batch_agents
from gplfd_policies.agents.model_based.oracle import OracleAgent
from gplfd_policies.arrays.members import EVERY_MEMBER
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import YieldToAll
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.gp.kersting import KerstingNoise

RADII = (0.38, 0.50, 0.62)
WAYS_TO_FOLLOW = {
    (method.adaptation, method.phases, repr(method.config)) if method else name: name
    for name, one in reversed(POLICIES.items())
    for method in [one.method]
}.values()
"""One policy of every way to follow a movement; the others learn differently."""
FIELDS = [field.name for field in dataclasses.fields(AgentStep)]


@pytest.fixture(scope="module")
def agents_of(demonstrations):
    """One agent per door, each learned from demonstrations of its own, by name.

    Learned once: a reset makes them as new. The paper's method learns in one iteration
    instead of ten, which take half a minute and change nothing of how it is followed.
    """
    lessons = (demonstrations[:4], demonstrations, demonstrations[1:])
    quick_fit = partial(fit_skill, noise=KerstingNoise(n_iterations=1))

    def learned(name, lesson):
        if name != "gp-paper":
            return make_agent(name, lesson)
        method = dataclasses.replace(POLICIES[name].method, fit=quick_fit)
        return method(TrainingInput(demonstrations=lesson))

    @cache
    def make(name):
        agents = tuple(learned(name, lesson) for lesson in lessons)
        for agent, radius in zip(agents, RADII, strict=True):
            agent.inform(DoorGeometry.nominal(radius))
        return agents

    return make


class Doors:
    """Doors that are opened step by step, whatever is commanded, and pull and shake."""

    def __init__(self):
        self.angles, self.rng = np.zeros(len(RADII)), np.random.default_rng(0)

    def observe(self):
        poses = [
            handle_pose_on_arc(radius, angle)
            for radius, angle in zip(RADII, self.angles, strict=True)
        ]
        shape = (len(RADII), 6)
        return {
            "ee_pose": np.array(poses) + 1e-4 * self.rng.normal(size=shape),
            "wrench": self.rng.normal(size=shape) * [9.0, 3.0, 3.0, 0.1, 0.1, 0.1],
        }


def row(observations, member):
    return {name: rows[member] for name, rows in observations.items()}


def assert_same_row(steps, member, step):
    for name in FIELDS:
        found, expected = getattr(steps.row(member), name), getattr(step, name)
        np.testing.assert_array_equal(found, expected, err_msg=name)
        np.testing.assert_array_equal(getattr(steps, name)[member], expected)


def steps_of(batch, closing=None, active=lambda time: np.ones(3, dtype=bool)):
    """Open doors with a batch; return observations, steps and who acted, by time."""
    doors, history = Doors(), []
    observations = doors.observe()
    batch.reset(observations)
    for time in range(60):
        if time == closing:
            doors.angles[1] = 0.0
        observations, acting = doors.observe(), active(time)
        if time == closing:
            batch.reset(observations, np.arange(3) == 1)
        steps = batch.act(observations, None if acting.all() else acting)
        history.append((observations, steps, acting))
        doors.angles += 0.006 * acting
    return history


@pytest.mark.parametrize("name", WAYS_TO_FOLLOW)
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_rows_of_a_batch_are_the_steps_of_its_agents(name, agents_of):
    """Member 0 ends early; 1 pauses and then begins anew; 2 starts late and goes on."""

    def active(time):
        return np.array([time < 20, not 24 < time < 30, time > 0])

    batch = batch_agents(agents_of(name))
    assert isinstance(batch, AgentBatch)
    history = steps_of(batch, closing=30, active=active)
    forecasts = [batch.forecast(member) for member in range(3)]
    for member, agent in enumerate(agents_of(name)):
        agent.reset(row(history[0][0], member))
        for time, (observations, steps, acting) in enumerate(history):
            if time == 30 and member == 1:
                agent.reset(row(observations, member))
            if acting[member]:
                assert_same_row(steps, member, agent.act(row(observations, member)))
        expected = agent.forecast()
        assert (forecasts[member] is None) == (expected is None)
        if expected is not None:
            np.testing.assert_array_equal(forecasts[member].mean, expected.mean)
            np.testing.assert_array_equal(forecasts[member].std, expected.std)


def off_by_eight_bytes(rows):
    """Half of the rows begin where no vector register would like them to."""
    buffer = np.empty(rows.size + 1)
    shifted = buffer[1:].reshape(rows.shape)
    shifted[...] = rows
    return shifted


LAYOUTS = {
    "packed": np.ascontiguousarray,
    "by columns": np.asfortranarray,
    "every other number": lambda rows: np.repeat(rows, 2, axis=1)[:, ::2],
    "off by eight bytes": off_by_eight_bytes,
}


@pytest.fixture(scope="module")
def seven(agents_of):
    """Seven agents to act together, and the same seven to act alone."""
    agents = [agents_of("gp")[member % 3] for member in range(7)]
    return [[copy.deepcopy(agent) for agent in agents] for _ in range(2)]


@pytest.mark.bits
@given(
    order=st.permutations(range(7)),
    count=st.integers(1, 7),
    layout=st.sampled_from(sorted(LAYOUTS)),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=12)
def test_no_other_member_changes_what_one_does(seven, order, count, layout, seed):
    """Whoever else is there, in whatever order, and wherever the numbers lie."""
    chosen = order[:count]
    together, alone = ([agents[member] for member in chosen] for agents in seven)
    batch = batch_agents(together)
    rng = np.random.default_rng(seed)
    angles, radii = np.zeros(count), rng.uniform(0.3, 0.65, count)
    for time in range(10):
        poses = [handle_pose_on_arc(*door) for door in zip(radii, angles, strict=True)]
        observations = {
            "ee_pose": np.array(poses) + 1e-3 * rng.normal(size=(count, 6)),
            "wrench": rng.normal(size=(count, 6)) * np.repeat([20.0, 0.5], 3),
        }
        if time == 0:
            batch.reset(observations)
            for member, agent in enumerate(alone):
                agent.reset(row(observations, member))
        acting = rng.random(count) < 0.8
        placed = {name: LAYOUTS[layout](rows) for name, rows in observations.items()}
        steps = batch.act(placed, acting)
        for member in np.flatnonzero(acting):
            own = {name: rows[member].copy() for name, rows in observations.items()}
            assert_same_row(steps, member, alone[member].act(own))
        angles += rng.uniform(0.0, 0.1, count)


def test_every_member_takes_via_points(agents_of):
    history = steps_of(batch_agents(agents_of("gp")))
    assert np.sum([steps.via_point for _, steps, _ in history], axis=0).min() > 10


@pytest.mark.parametrize("name", ["gp-fixed", "oracle"])
def test_members_that_do_not_act_hold_still(name, agents_of):
    batch, doors = batch_agents(agents_of(name)), Doors()
    batch.reset(doors.observe())
    before = batch.act(doors.observe())
    observations = doors.observe()
    for rows in observations.values():
        rows[1] = np.nan  # not looked at
    steps = batch.act(observations, np.array([True, False, True]))
    np.testing.assert_array_equal(steps.action[1], before.action[1])
    assert not steps.via_point[1]
    for name in set(FIELDS) - {"action", "via_point"}:
        assert np.isnan(getattr(steps, name)[1]).all()
    again = batch.act(observations, np.zeros(3, dtype=bool))
    np.testing.assert_array_equal(again.action, steps.action)


def test_batches_of_one_configuration_decide_at_once(agents_of):
    """The load rule is asked once, not once per member."""
    calls = []

    class Counting(YieldToAll):
        def meet(self, encounter, members=EVERY_MEMBER):
            calls.append(len(encounter.wrench))
            return super().meet(encounter, members)

    rule = Counting()
    agents = [
        dataclasses.replace(agent, config=ComplianceConfig(load=rule))
        for agent in agents_of("gp-fixed")
    ]
    batch, doors = batch_agents(agents), Doors()
    batch.reset(doors.observe())
    batch.act(doors.observe())
    batch.act(doors.observe(), np.array([True, False, True]))
    assert calls == [3, 2]


@pytest.mark.parametrize("other", ["gp-clock", "gp-constant-500", "oracle"])
def test_agents_of_any_configuration_act_together(other, agents_of):
    members = [*agents_of("gp")[:2], agents_of(other)[2]]
    history = steps_of(batch_agents(members))
    for member, agent in enumerate(members):
        agent.reset(row(history[0][0], member))
        for observations, steps, _ in history:
            assert_same_row(steps, member, agent.act(row(observations, member)))


def test_steps_are_records_of_their_own(agents_of):
    batch, doors = batch_agents(agents_of("gp-fixed")), Doors()
    batch.reset(doors.observe())
    first = batch.act(doors.observe())
    kept = {name: getattr(first, name).copy() for name in FIELDS}
    for _ in range(5):
        batch.act(doors.observe())
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(first, name), kept[name])
        with pytest.raises(ValueError, match="read-only"):
            getattr(first, name)[0] = 0


def test_observations_are_not_changed(agents_of):
    batch, doors = batch_agents(agents_of("gp-fixed")), Doors()
    observations = doors.observe()
    given = {name: rows.copy() for name, rows in observations.items()}
    batch.reset(observations)
    batch.act(observations)
    for name, rows in given.items():
        np.testing.assert_array_equal(observations[name], rows)
        assert observations[name].flags.writeable


def test_a_batch_needs_agents_that_differ():
    with pytest.raises(ValueError, match="at least one"):
        batch_agents([])
    agent = OracleAgent()
    with pytest.raises(ValueError, match="given twice"):
        batch_agents([agent, agent])


@pytest.mark.parametrize("mask", [np.ones(3), np.ones(2, dtype=bool), [True]])
@pytest.mark.parametrize("name", ["gp-fixed", "oracle"])
def test_masks_name_every_member(name, mask, agents_of):
    batch, doors = batch_agents(agents_of(name)), Doors()
    with pytest.raises(ValueError, match=r"boolean of shape \(3,\)"):
        batch.reset(doors.observe(), np.array(mask))
