"""Policies: a learner in a pipeline, or any function that makes an agent."""

import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final, Literal, NamedTuple

import numpy as np

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.adaptation import own_adaptation
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.adaptation.similarity import SimilarityAdaptation
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.agents.modes import ModeConfig, ModesAgent
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.shapes import Float
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import YieldToAll
from gplfd_policies.control.rendering import ARM_DYNAMICS, ArmRendering
from gplfd_policies.control.stiffness import (
    DEFAULT_PROFILE,
    PhaseStiffness,
    StiffnessProfile,
)
from gplfd_policies.demonstrations.aligned import (
    AlignedDemonstrations,
    continued,
    partition,
)
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import (
    Correction,
    Demonstration,
    checked_demonstrations,
)
from gplfd_policies.movements.movement import (
    AdaptationForm,
    EmpiricalDistribution,
    LearnedMovement,
    Movement,
    Predictor,
    as_movement,
)
from gplfd_policies.movements.prior_mean import PriorMean, fit_residual
from gplfd_policies.movements.skill import Skill
from gplfd_policies.phase.phase_rule import ClockPhase, PathPhase, PhaseRule

_GRID: Final = 100  # number of grid phases of an agent's movement
_STEEPNESS: Final = 6.0
"""αβ of the published values: at σ = 0 the stiffness is within 0.25 % of k_max."""
_START_TOLERANCE: Final = (0.05, 0.2)
"""Greatest distance of a demonstration's start from the closed handle [m, rad]."""
_LARGEST_REACH: Final = 3.0
"""Greatest distance of a demonstration from the closed handle [m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingInput:
    """Input from which a policy learns."""

    demonstrations: Sequence[Demonstration]
    """At least one demonstration; in the task frame if the policy opens doors."""
    seed: int = 0
    """Seed for random numbers in learning."""
    prior_mean: PriorMean | None = None
    """Expected poses far from demonstrations, or None; only for some methods."""

    def __post_init__(self) -> None:
        demonstrations = checked_demonstrations(self.demonstrations)
        object.__setattr__(self, "demonstrations", demonstrations)

    def of(self, numbers: Iterable[int]) -> "TrainingInput":
        """Return the input with these of its demonstrations only."""
        chosen = [self.demonstrations[number] for number in numbers]
        return replace(self, demonstrations=chosen)


def demonstrated_phase(movement: Movement) -> PhaseRule:
    """Return a rule that uses the demonstrations' mean and spread."""
    return PathPhase(EmpiricalDistribution(aligned=movement.aligned))


def clock_phase(movement: Movement) -> PhaseRule:
    """Return a rule that uses the phase of the command, i.e. time, as in the paper."""
    return ClockPhase()


def profile_of_spread(
    aligned: AlignedDemonstrations, resolution: tuple[float, float] = (1e-4, 3e-2)
) -> StiffnessProfile:
    """Scale the stiffness profile, Eq. (24), by the demonstrations' spread.

    β is the geometric mean of two values: the root mean square spread, which is σ
    before the policy has observed the task, and the residual pose uncertainty after a
    long observation, ``resolution`` [m, rad], which is the least σ. The shape over σ/β
    and the stiffnesses are the published ones. The default resolution is that of `gp`.
    """
    poses = aligned.demonstrated.poses
    if len(poses) < 2:
        return DEFAULT_PROFILE
    least = np.repeat(resolution, 3)
    spread = np.sqrt(poses.var(axis=0, ddof=1).mean(axis=0))
    beta = np.sqrt(least * np.maximum(spread, least))
    return replace(DEFAULT_PROFILE, alpha=_STEEPNESS / beta, beta=beta)


@dataclass(frozen=True, kw_only=True, slots=True)
class Learner:
    """A learning method: how a movement is learned, and how it adapts by itself.

    It can be pickled if its functions can be; variants: `dataclasses.replace`.
    """

    fit: Callable[..., Predictor]
    """Learns from `AlignedDemonstrations`. What it returns has ``predict(phases)``, as
    in `Predictor`, or with mean and standard deviation [m, rad], each (M, 6)."""
    summary: str = "a learner of a user"
    """One line for people."""
    seeded: bool = False
    """Whether learning draws random numbers: `fit` then also takes ``seed=``."""
    accepts_prior_mean: bool = False
    """Whether `fit` also takes ``centred=False``, for a prior mean of zero."""
    adaptation: AdaptationForm | None = None
    """Its form of adaptation; None for the ``adapt`` of what it fitted, if any."""
    force_adaptation: AdaptationForm | None = None
    """That of the expected force to measured forces; None for the same form."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Pipeline:
    """What surrounds a learner: no part of it needs a particular one."""

    align: Callable[[Sequence[Demonstration]], AlignedDemonstrations] = align
    """Aligns demonstrations to common phases."""
    beyond: float = 0.5
    """Length of the continuation beyond the end, as a share of the path; 0 for none."""
    modes: ModeConfig | None = field(default_factory=ModeConfig)
    """Criteria for abandoning a mode; None to learn all demonstrations as one."""
    adapts: bool = True
    """Whether poses and forces that the agent observes change its forecast."""
    size_inference: AdaptationForm | None = SimilarityAdaptation
    """Adaptation that infers size and heading of the path; None: the learner's own."""
    phases: Callable[[Movement], PhaseRule] = PathPhase
    """Makes an agent's rule for the phase; by default by the movement's mean and σ."""
    profile: StiffnessProfile | Callable[[AlignedDemonstrations], StiffnessProfile] = (
        profile_of_spread
    )
    """Stiffness profile, or a function that gives it; it replaces that of `config`."""
    phase_stiffness: Callable[[Movement, StiffnessProfile], PhaseStiffness] | None = (
        None
    )
    """Gives a stiffness from demonstrated forces, such as `stiffness_from_force`."""
    config: ComplianceConfig = field(default_factory=ComplianceConfig)
    """Other settings for following the movement: load, timing, via-points."""

    def __post_init__(self) -> None:
        if self.config.profile is not DEFAULT_PROFILE:
            raise ValueError("give the profile as Pipeline(profile=...), not in config")


@dataclass(frozen=True, kw_only=True, slots=True)
class Method:
    """A learner in a pipeline; calling it learns and makes an agent."""

    learner: Learner
    pipeline: Pipeline = field(default_factory=Pipeline)

    def adaptation(self, movement: Movement) -> AdaptationForm | None:
        """Return the learner's form of adaptation of a movement; None without."""
        form = self.learner.adaptation or own_adaptation(movement)
        return form if self.pipeline.adapts else None

    def force_adaptation(self, forces: Movement) -> AdaptationForm | None:
        """Return the form of adaptation of the expected forces; None without."""
        form = self.learner.force_adaptation if self.pipeline.adapts else None
        return form or self.adaptation(forces)

    def learn(self, training: TrainingInput) -> Movement:
        """Learn a movement, around the prior mean if one is given.

        The demonstrations may be of any task, in any common frame.

        Raises:
            ValueError: No demonstrations, or a prior mean that the learner cannot use.
        """
        prior_mean, learner = training.prior_mean, self.learner
        if prior_mean is not None and not learner.accepts_prior_mean:
            raise ValueError(
                f"{learner.summary} accepts no prior mean; another learner, "
                "such as gp, does"
            )
        if not training.demonstrations:
            raise ValueError("no demonstrations were given; at least one is needed")
        pipeline = self.pipeline
        aligned = continued(pipeline.align(training.demonstrations), pipeline.beyond)
        fit, seed = learner.fit, training.seed
        fit = partial(fit, seed=seed) if learner.seeded else fit
        if prior_mean is None:
            movement = as_movement(fit(aligned), aligned)
        else:
            movement = fit_residual(aligned, prior_mean, partial(fit, centred=False))
        forces = aligned.forces
        if forces is None or not isinstance(movement, LearnedMovement):
            return movement
        with warnings.catch_warnings():
            # Learning of the motion has already warned about too few demonstrations.
            warnings.simplefilter("ignore", UserWarning)
            learned = as_movement(fit(forces), forces)
            return replace(movement, forces=learned)

    def modes(self, training: TrainingInput) -> tuple[tuple[int, ...], ...]:
        """Return the demonstrations' numbers by their mode, the largest mode first."""
        demonstrations = training.demonstrations
        if self.pipeline.modes is None or len(demonstrations) < 2:
            return (tuple(range(len(demonstrations))),)
        with warnings.catch_warnings():
            # Learning aligns them again and then warns.
            warnings.simplefilter("ignore", UserWarning)
            return partition(self.pipeline.align(demonstrations))

    def learn_modes(self, training: TrainingInput) -> "tuple[LearnedMode, ...]":
        """Learn a movement of every mode of the demonstrations, the largest mode first.

        Raises the same errors as `learn`.
        """
        return tuple(
            LearnedMode(numbers, self.learn(training.of(numbers)))
            for numbers in self.modes(training)
        )

    def follow(self, movement: Movement) -> CompliantAgent:
        """Return an agent that follows a movement at doors, as others may.

        Raises:
            ValueError: The demonstrations of the movement do not begin at the closed
                handle, are not in metres, or lack necessary wrenches.
        """
        _check_starts(movement.aligned.demonstrated.poses)
        pipeline = self.pipeline
        profile, learned = pipeline.profile, pipeline.phase_stiffness
        if not isinstance(profile, StiffnessProfile):
            profile = profile(movement.aligned)
        stiffness = learned and learned(movement, profile)
        forces = None
        if isinstance(movement, LearnedMovement) and movement.forces is not None:
            # A single demonstration does not show how repetitions differ.
            alone = len(movement.forces.aligned.poses) < 2
            form = None if alone else self.force_adaptation(movement.forces)
            forces = GriddedMovement(movement.forces, form, _GRID)
        inference = pipeline.size_inference if pipeline.adapts else None
        return CompliantAgent(
            GriddedMovement(movement, inference or self.adaptation(movement), _GRID),
            phases=pipeline.phases(movement),
            config=replace(pipeline.config, profile=profile, phase_stiffness=stiffness),
            forces=forces,
        )

    def follow_modes(
        self, modes: "Sequence[LearnedMode]"
    ) -> CompliantAgent | ModesAgent:
        """Return an agent that follows the movement, or tries those of several modes.

        Raises the same errors as `follow`.
        """
        agents = [self.follow(mode.movement) for mode in modes]
        if self.pipeline.modes is None or len(agents) == 1:
            return agents[0]
        counts = [len(mode.numbers) for mode in modes]
        return ModesAgent(agents, counts, self.pipeline.modes)

    def open_loop(self, period: float) -> "Method":
        """Return the method without measurements, whose commands a file can contain.

        It has no adaptation and no load compensation, and is driven by time, one
        command per period [s]. The arm itself renders the stiffness, along task axes.
        """
        if self.pipeline.phase_stiffness is not None:
            raise ValueError(
                "this policy has a stiffness along the path, which numbers along fixed "
                "axes cannot express; choose another, such as gp"
            )
        config = replace(
            self.pipeline.config,
            load=YieldToAll(),
            rendering=ArmRendering,
            dynamics=ARM_DYNAMICS,
            stiffness_frame="axes",
            control_period=period,
            via_spacing=2.0,  # longer than the task: no via-points
        )
        pipeline = replace(
            self.pipeline, adapts=False, modes=None, phases=clock_phase, config=config
        )
        return replace(self, pipeline=pipeline)

    def __call__(self, training: TrainingInput) -> CompliantAgent | ModesAgent:
        """Learn a movement and return an agent that follows it at doors."""
        _check_starts(demonstration.poses for demonstration in training.demonstrations)
        return self.follow_modes(self.learn_modes(training))

    def update(self, movement: Movement, correction: Correction) -> Movement:
        """Learn again from a movement's demonstrations and a completed correction."""
        whole = self.completed(movement, correction)
        demonstrations = (*as_demonstrations(movement.aligned), whole)
        with warnings.catch_warnings():
            # The first learning has already warned about the demonstrations.
            warnings.simplefilter("ignore", UserWarning)
            learned = self.learn(TrainingInput(demonstrations=demonstrations))
        if isinstance(movement, Skill) and isinstance(learned, Skill):
            corrections = (*movement.corrections, correction)
            return replace(learned, frame=movement.frame, corrections=corrections)
        return learned

    def completed(self, movement: Movement, correction: Correction) -> Demonstration:
        """Return the motion of a correction, continued by the expected movement.

        A permanent via-point would bend the movement at all doors, a whole motion does
        not. The movement observes it as in an episode: it is conditioned on via-points
        at the estimated phases, with the noise of the led hand. If the motion ends
        early, the conditioned mean follows from its last pose, with its last wrench.
        """
        config = replace(self.pipeline.config, via_std=correction.std)
        following = replace(self, pipeline=replace(self.pipeline, config=config))
        agent = following.follow(movement)
        motion, phase = correction.motion, 0.0
        felt = motion.wrenches
        wrenches = np.zeros_like(motion.poses) if felt is None else -felt
        agent.reset({"ee_pose": motion.poses[0]})
        for pose, wrench in zip(motion.poses, wrenches, strict=True):
            step = agent.act({"ee_pose": pose, "wrench": wrench})
            phase = float(step.observed_phase)
        expected, end = agent.forecast(), movement.aligned.end
        after = (expected.times > phase) & (expected.times <= end)
        last = interpolated(np.array([phase]), expected.times, expected.mean)
        later = movement.duration * (expected.times[after] - phase)
        rest = expected.mean[after] + (motion.poses[-1] - last)
        whole = np.vstack([motion.poses, rest])
        whole[:, 3:] = unwrap_rotvecs(whole[:, 3:])
        if felt is not None:
            felt = np.vstack([felt, np.repeat(felt[-1:], len(later), axis=0)])
        times = np.concatenate([motion.times, motion.times[-1] + later])
        return Demonstration(times=times, poses=whole, wrenches=felt)


class LearnedMode(NamedTuple):
    """The movement of one mode, and the indices of its demonstrations."""

    numbers: tuple[int, ...]
    movement: Movement


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyOrigin:
    """Origin of a policy, as plain data."""

    name: str
    """The name under which it was requested."""
    kind: Literal["built-in", "package", "module", "server"] = "built-in"
    """An entry of `POLICIES`, a package's entry point, a user's module, or a server."""
    folder: str = ""
    """Folder in which the module was searched first."""
    file: str = ""
    """Source file of the module."""
    sha256: str = ""
    """Hash of that file, and of those of its folder that it imports, hexadecimal."""
    distribution: str = ""
    """Name of the installed package, and its version."""
    version: str = ""
    metadata: str = ""
    """What the server states, as JSON."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """A registered policy: summary, function that makes agents, and origin."""

    summary: str
    """One line for people."""
    make: Callable[[TrainingInput], object]
    """A `Method`, or any function that learns from the training input and returns an
    agent, or an object that `gplfd_policies.as_agent` accepts."""
    kind: Literal["method", "ablation", "reference"] = "method"
    """A learner in the default pipeline, or as published; in a pipeline of which parts
    are changed; or a model-based policy, which does not learn from demonstrations."""
    told: bool = False
    """Whether its agents need the true door, by `Agent.inform`."""
    origin: PolicyOrigin | None = None
    """Origin; `policy_named` adds it."""

    @property
    def method(self) -> Method | None:
        """The method, or None if agents do not follow a learned movement."""
        return self.make if isinstance(self.make, Method) else None


def _check_starts(demonstrated: Iterable[Float[np.ndarray, "_ 6"]]) -> None:
    """Raise unless demonstrations begin at the closed handle of a door, in metres."""
    for number, poses in enumerate(demonstrated):
        start, reach = poses[0], np.abs(poses[:, :3]).max()
        if reach > _LARGEST_REACH:
            raise ValueError(
                f"demonstration {number} reaches {reach:.3g} m from the closed handle; "
                "are its positions in metres, in the task frame?"
            )
        distance, turn = np.linalg.norm(start[:3]), np.linalg.norm(start[3:])
        if distance > _START_TOLERANCE[0] or turn > _START_TOLERANCE[1]:
            raise ValueError(
                f"demonstration {number} starts {distance:.3g} m and {turn:.3g} rad "
                "away from the closed handle, which is the origin of the task frame (x "
                "pull, y up); use demonstration.relative_to_first() if its first pose "
                "has these axes, or gplfd demos import --frame hinge"
            )


def as_demonstrations(aligned: AlignedDemonstrations) -> tuple[Demonstration, ...]:
    """Return aligned demonstrations as demonstrations with common time stamps."""
    phases = np.linspace(0.0, aligned.end, len(aligned.times))
    demonstrations = []
    for number, curves in enumerate(aligned.poses):
        poses = interpolated(phases, aligned.times, curves)
        wrenches = None
        if aligned.wrenches is not None and np.isfinite(aligned.wrenches[number]).all():
            forces = interpolated(phases, aligned.times, aligned.wrenches[number])
            forces = forces.reshape(-1, 2, 3)
            wrenches = into_axes(-poses[:, None, 3:], forces).reshape(-1, 6)
        motion = {"times": aligned.duration * phases, "poses": poses}
        demonstrations.append(Demonstration(**motion, wrenches=wrenches))
    return tuple(demonstrations)
