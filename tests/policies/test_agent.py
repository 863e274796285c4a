"""The compliant agent: movement, adaptation, stiffness and admittance together."""

import dataclasses

import jaxtyping
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_policies.adaptation import ProcessAdaptation
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.arrays.members import EVERY_MEMBER
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import CarriedLoad, YieldToAll
from gplfd_policies.control.stability import rate_bound
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, DEFAULT_PROFILE
from gplfd_policies.movements.empirical import EmpiricalDistribution
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.phase.path_phase import PathPhase
from gplfd_policies.phase.phase_rule import POSE_ERROR, ClockPhase, PhaseEstimate
from gplfd_policies.registry.catalogue import make_agent

PERIOD = 0.01


def agent_of(skill, form=ProcessAdaptation, **config):
    return CompliantAgent(
        movement=GriddedMovement(skill, form, 100),
        phases=PathPhase(skill, skill.aligned),
        config=ComplianceConfig(load=CarriedLoad(limit=20.0), **config),
    )


def observed(pose, force=(0.0, 0.0, 0.0)):
    return {"ee_pose": np.array(pose), "wrench": np.array([*force, 0.0, 0.0, 0.0])}


def ideal_door(agent, radius, steps):
    """A weightless door: the handle goes to the point of its arc nearest the command.

    The hand feels what a spring of 2000 N/m across the arc would exert.
    """
    angle, history = 0.0, []
    agent.reset(observed(np.zeros(6)))
    force = np.zeros(3)
    for _ in range(steps):
        step = agent.act(observed(handle_pose_on_arc(radius, angle), force))
        x, _, z = step.action[:3]
        angle = max(0.0, np.arctan2(x, z + radius))
        handle = handle_pose_on_arc(radius, angle)[:3]
        force = 2000.0 * (handle - step.action[:3])
        history.append((step, angle))
    return history


@pytest.mark.parametrize("radius", [0.35, 0.50, 0.65, 0.42])
def test_adaptation_finds_the_radius_of_an_ideal_door(skill, radius):
    agent = agent_of(skill)
    _, angles = zip(*ideal_door(agent, radius, 700), strict=True)
    assert angles[-1] > np.radians(62.0)
    end = agent.forecast().mean[-1]
    expected = handle_pose_on_arc(radius, end[4])
    np.testing.assert_allclose(end[[0, 2]], expected[[0, 2]], atol=0.03)


def test_without_adaptation_the_policy_stays_as_demonstrated(skill):
    agent = agent_of(skill, None)
    before = agent.forecast().mean
    ideal_door(agent, 0.35, 600)
    np.testing.assert_array_equal(agent.forecast().mean, before)


def test_step_reports_the_uncertainty_that_set_the_stiffness(skill):
    history = ideal_door(agent_of(skill), 0.5, 400)
    stds = np.array([step.std for step, _ in history])
    rates = np.array([step.std_rate for step, _ in history])
    np.testing.assert_allclose(rates[1:], np.diff(stds, axis=0) / PERIOD, atol=1e-9)
    wished = DEFAULT_PROFILE.stiffness(stds)
    stiffness = np.array([step.stiffness for step, _ in history])
    assert np.all(stiffness <= wished + 1e-9)
    stiffness_rates = np.array([step.stiffness_rate for step, _ in history])
    np.testing.assert_allclose(
        stiffness_rates[1:], np.diff(stiffness, axis=0) / PERIOD, atol=1e-6
    )


@pytest.mark.parametrize("radius", [0.35, 0.65])
def test_rendered_stiffness_keeps_the_stability_bound(skill, radius):
    """Recomputed from the stiffness alone, not from what the governor reports."""
    history = ideal_door(agent_of(skill, via_spacing=0.2), radius, 600)
    stiffness = np.array([step.stiffness for step, _ in history])
    rate = np.diff(stiffness, axis=0) / PERIOD
    bound = rate_bound(stiffness[:-1], DEFAULT_PROFILE.k_min, DEFAULT_DYNAMICS)
    assert (bound - rate).min() > 0.0
    # Ungoverned it would be crossed: rare via-points drop the uncertainty at once.
    wished = np.array([DEFAULT_PROFILE.stiffness(step.std) for step, _ in history])
    ungoverned = np.diff(wished, axis=0) / PERIOD
    bound = rate_bound(wished[:-1], DEFAULT_PROFILE.k_min, DEFAULT_DYNAMICS)
    assert (bound - ungoverned).min() < 0.0


@pytest.mark.parametrize("name", ["gp-paper", "gp"])
def test_fig10_compliance_towards_the_hinge_rises_to_the_end(name, demonstrations):
    agent = make_agent(name, demonstrations)
    opened = ideal_door(agent, 0.5, round(agent.movement.learned.duration / PERIOD))
    angles = np.array([angle for _, angle in opened])
    stiffness = np.array([step.stiffness[2] for step, _ in opened])
    thirds = [
        stiffness[(angles > low) & (angles <= low + 0.35)].mean()
        for low in (0.0, 0.35, 0.7)
    ]
    assert thirds[0] > thirds[1] > thirds[2]


def test_via_points_share_what_the_phase_leaves_open(skill, monkeypatch):
    agent, seen = agent_of(skill), []
    monkeypatch.setattr(agent.movement, "observe", seen.append)
    agent.reset(observed(np.zeros(6)))
    rates = []
    for angle in np.linspace(0.0, 0.8, 200):
        pose = handle_pose_on_arc(0.5, angle)
        if agent.act(observed(pose)).via_point:
            rates.append(agent.phases.rate(np.float64(seen[-1].phase)))
    assert len(seen) > 10
    for via_point, rate in zip(seen, rates, strict=True):
        np.testing.assert_array_equal(via_point.std, np.repeat(POSE_ERROR, 3))
        # Along the path, by one standard deviation of the phase.
        std = np.linalg.norm(via_point.along) / np.linalg.norm(rate)
        assert std > 0.0
        np.testing.assert_allclose(via_point.along, std * rate, rtol=1e-9)


def test_steps_are_records_of_their_own(skill):
    agent = agent_of(skill)
    agent.reset(observed(np.zeros(6)))
    step = agent.act(observed(np.zeros(6)))
    with pytest.raises(ValueError, match="read-only"):
        step.std[0] = 1.0


@pytest.mark.parametrize(
    "wrong",
    [
        {"control_period": 0.0},
        {"via_spacing": -0.1},
        {"max_turn_lead": np.nan},
        {"via_std": (-1e-3, 0.0)},
    ],
)
def test_impossible_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=rf"ComplianceConfig\.{next(iter(wrong))}"):
        ComplianceConfig(**wrong)


def test_a_config_takes_load_rules_alone(monkeypatch):
    # Users have no type checker at run time.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    with pytest.raises(ValueError, match=r"ComplianceConfig\.load must be a load rule"):
        ComplianceConfig(load=object())


def test_clock_runs_at_the_demonstrated_speed_on_a_free_door(skill):
    steps = round(skill.duration / PERIOD)
    history = ideal_door(agent_of(skill), 0.5, steps + 40)
    assert history[-1][0].phase == 1.0
    assert history[steps // 2][0].phase == pytest.approx(0.5, abs=0.02)


def test_lag_does_not_slow_the_clock_down(skill):
    # The hand stands still, without a force: the command must go on all the same.
    agent = agent_of(skill)
    agent.reset(observed(np.zeros(6)))
    phases = [agent.act(observed(np.zeros(6))).phase for _ in range(300)]
    assert phases[-1] == pytest.approx(300 * PERIOD / skill.duration, rel=1e-6)


def test_set_point_waits_at_the_largest_load(skill):
    agent = agent_of(skill)
    agent.reset(observed(np.zeros(6)))
    held_back = observed(np.zeros(6), force=(-20.0, 0.0, 0.0))
    phases = [agent.act(held_back).phase for _ in range(100)]
    assert phases[-1] < 0.05 * 100 * PERIOD / skill.duration


def test_resistance_along_the_path_is_carried_not_yielded_to(skill):
    agent = agent_of(skill)
    agent.reset(observed(np.zeros(6)))
    for _ in range(200):
        step = agent.act(observed(np.zeros(6), force=(-10.0, 0.0, 0.0)))
    # Along the pull nothing gives way; the tangent is x up to the path's first bend.
    assert abs(step.action[0] - step.desired[0]) < 5e-3


def held_hand(agent, delay, steps=600):
    """Hold the hand by a rigid bar across the path, commands being late by periods.

    Returns how far the set-point was displaced upwards, after a push of 10 N.
    """
    agent.reset(observed(np.zeros(6)))
    # A command holds for one period; then it is felt, without any delay.
    late, displaced = [0.0] * (delay + 1), []
    for count in range(steps):
        push = 10.0 if count < 20 else 0.0
        felt = observed(np.zeros(6), force=(0.0, push - 2000.0 * late[0], 0.0))
        step = agent.act(felt)
        late = [*late[1:], step.action[1]]
        displaced.append(step.action[1] - step.desired[1])
    return np.abs(displaced)


@pytest.mark.parametrize("stiffness", [100.0, 200.0, 330.0])
def test_a_held_hand_stays_calm_although_commands_are_late(skill, stiffness):
    constant = np.repeat([stiffness, 0.1 * stiffness], 3)
    profile = dataclasses.replace(DEFAULT_PROFILE, k_min=constant, k_max=constant)
    displaced = held_hand(agent_of(skill, None, profile=profile), 3)
    assert displaced[-100:].max() < 0.05 * displaced.max()
    undamped = dataclasses.replace(DEFAULT_DYNAMICS, least_damping=np.zeros(6))
    displaced = held_hand(agent_of(skill, None, profile=profile, dynamics=undamped), 3)
    assert displaced[-100:].max() > 10.0 * displaced[:30].max()


def test_a_hand_that_is_held_becomes_soft(skill):
    """Held against the pull: σ along the path grows by the give, the clock waits."""
    agent = dataclasses.replace(agent_of(skill), config=ComplianceConfig())
    agent.reset(observed(np.zeros(6)))
    step = agent.act(observed(np.zeros(6)))
    assert step.stiffness[0] > 450.0
    for _ in range(1500):
        force = -2000.0 * step.action[0]
        step = agent.act(observed(np.zeros(6), force=(force, 0.0, 0.0)))
    assert force == pytest.approx(-13.0, abs=0.5)
    assert step.stiffness[0] == pytest.approx(100.0, abs=1.0)
    assert step.give == pytest.approx(0.03, abs=2e-3)
    assert step.std[0] >= 0.99 * step.give
    freed = [agent.act(observed(np.zeros(6))) for _ in range(200)]
    assert freed[-1].give < 5e-3
    assert min(step.stability_margin[0] for step in freed) > 0.0


def test_force_across_the_path_is_yielded_to(skill):
    agent = agent_of(skill, None)
    agent.reset(observed(np.zeros(6)))
    for _ in range(100):
        step = agent.act(observed(np.zeros(6), force=(0.0, 5.0, 0.0)))
    expected = 5.0 / step.stiffness[1]
    assert step.action[1] - step.desired[1] == pytest.approx(expected, rel=0.05)


def test_rotation_offset_is_composed_not_added(skill):
    agent = agent_of(skill, None)
    pose = handle_pose_on_arc(0.5, 0.8)
    agent.reset(observed(pose))
    observation = observed(pose)
    observation["wrench"][3:] = (0.5, 0.0, 0.0)
    for _ in range(400):
        step = agent.act(observation)
    turn = Rotation.from_rotvec(step.action[3:].copy())
    offset = turn * Rotation.from_rotvec(step.desired[3:].copy()).inv()
    np.testing.assert_allclose(offset.as_rotvec()[1:], 0.0, atol=1e-9)
    assert offset.as_rotvec()[0] > 0.005


def test_rotation_leads_by_less_than_the_pull(skill):
    agent = agent_of(skill, None, max_turn_lead=0.05)
    agent.reset(observed(np.zeros(6)))
    for _ in range(300):
        step = agent.act(observed(np.zeros(6)))
    ahead, _ = agent.movement.at(step.observed_phase + 0.05)
    np.testing.assert_allclose(step.desired[3:], ahead[3:])
    assert step.phase > step.observed_phase + 0.2


def test_reset_forgets_the_last_door(skill):
    fresh = agent_of(skill)
    used = agent_of(skill)
    ideal_door(used, 0.35, 300)
    for (one, _), (other, _) in zip(
        ideal_door(fresh, 0.6, 200), ideal_door(used, 0.6, 200), strict=True
    ):
        np.testing.assert_array_equal(one.action, other.action)


def test_via_points_are_spaced_in_phase(skill):
    history = ideal_door(agent_of(skill, via_spacing=0.02), 0.5, 500)
    taken = [step.observed_phase for step, _ in history if step.via_point]
    assert len(taken) > 20
    assert np.diff(taken).min() >= 0.02 - 1e-12


def test_via_points_are_taken_again_after_a_phase_that_was_wrong(skill):
    told = iter([0.1, 0.2, 0.7, 0.21, 0.22, 0.25, 0.24])

    class Told(ClockPhase):
        def update(self, poses, previous, command, members=EVERY_MEMBER):
            nothing = np.zeros_like(command)
            return PhaseEstimate(np.full_like(command, next(told)), nothing, nothing)

    agent = dataclasses.replace(agent_of(skill, via_spacing=0.02), phases=Told())
    agent.reset(observed(np.zeros(6)))
    taken = [bool(agent.act(observed(np.zeros(6))).via_point) for _ in range(7)]
    assert taken == [True, True, True, True, False, True, False]


def test_direction_is_that_of_the_path_as_just_adapted(skill):
    directions = []

    class Watching(YieldToAll):
        def meet(self, encounter, members=EVERY_MEMBER):
            directions.append(encounter.direction)
            return super().meet(encounter, members)

    agent = dataclasses.replace(
        agent_of(skill), config=ComplianceConfig(load=Watching())
    )
    agent.reset(observed(np.zeros(6)))
    for angle in np.linspace(0.0, 0.9, 150):
        step = agent.act(observed(handle_pose_on_arc(0.42, angle)))
        ahead = min(step.observed_phase + 0.05, 1.0)
        chord = (agent.movement.at(ahead)[0] - agent.movement.at(ahead - 0.05)[0])[:3]
        expected = chord / np.linalg.norm(chord)
        np.testing.assert_allclose(directions[-1], expected, atol=1e-5)


class Curve:
    """A movement that knows where to go and nothing about the spread."""

    def __init__(self, skill):
        self.aligned, self.duration, self._skill = skill.aligned, skill.duration, skill

    def predict(self, times):
        mean = self._skill.predict(times).mean
        return GaussianTrajectory.from_moments(
            times, mean, np.full_like(mean, np.nan), lambda: np.empty(0)
        )


def test_policy_without_uncertainty_is_followed_stiffly(skill):
    curve = Curve(skill)
    agent = CompliantAgent(
        movement=GriddedMovement(curve, None, 100),
        phases=PathPhase(EmpiricalDistribution(curve.aligned), curve.aligned),
    )
    history = ideal_door(agent, 0.5, 300)
    assert history[-1][1] > np.radians(20.0)
    for step, _ in history:
        np.testing.assert_array_equal(step.stiffness, DEFAULT_PROFILE.k_max)
        for field in dataclasses.fields(step):
            unknown = field.name in ("std", "std_rate", "predicted_std")
            value = np.asarray(getattr(step, field.name))
            assert np.isnan(value).all() if unknown else np.isfinite(value).all()


def test_agents_cannot_be_changed_in_place(skill):
    # Their parts are put together once: a change would go unnoticed.
    with pytest.raises(dataclasses.FrozenInstanceError):
        agent_of(skill).config = ComplianceConfig()
