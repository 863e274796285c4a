"""A method: how a movement is learned from demonstrations, adapted and followed."""

import textwrap
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np

from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.agents.handles import HandleConfig
from gplfd_policies.agents.modes import ModeConfig, ModesAgent
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.arrays.shapes import Float
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.phase_stiffness import PhaseStiffness
from gplfd_policies.control.stiffness import (
    DEFAULT_PROFILE,
    StiffnessProfile,
    spread_profile,
)
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.continuation import continued
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.modes import partition
from gplfd_policies.movements.movement import (
    AdaptationForm,
    EmpiricalDistribution,
    LearnedMovement,
    Movement,
)
from gplfd_policies.movements.prior_mean import PriorMean, Stretched, fit_residual
from gplfd_policies.phase.path_phase import PathPhase, PathPhaseConfig
from gplfd_policies.phase.phase_rule import ClockPhase, PhaseRule

_GRID: Final = 100
"""Phases at which an agent knows its movement."""
_START_TOLERANCE: Final = (0.05, 0.2)
"""How far from the closed handle a demonstration may start [m, rad]."""
_LARGEST_REACH: Final = 3.0
"""How far from it a demonstration may ever be [m]."""
_PATH_PHASE: Final = PathPhaseConfig()


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingInput:
    """What a policy may learn from.

    Raises:
        TypeError: If the demonstrations are not a sequence of demonstrations.
    """

    demonstrations: Sequence[Demonstration]
    """At least one; in the task frame where doors are to be opened."""
    seed: int = 0
    """Seeds whatever is random in the learning."""
    prior_mean: PriorMean | None = None
    """What is expected where nothing was demonstrated, or None; some methods only."""

    def __post_init__(self) -> None:
        given = self.demonstrations
        several = tuple(given) if isinstance(given, Iterable) else (None,)
        if not all(isinstance(one, Demonstration) for one in several):
            raise TypeError(
                "demonstrations must be a sequence of gplfd_policies.Demonstration, "
                f"got {textwrap.shorten(repr(given), 80, placeholder=' ...')}; put a "
                "single one into a list: [demonstration]"
            )
        object.__setattr__(self, "demonstrations", several)


def path_phase(movement: Movement, config: PathPhaseConfig = _PATH_PHASE) -> PhaseRule:
    """Find the phase of a pose on the path, by the movement's own mean and spread."""
    return PathPhase(movement, movement.aligned, config)


def demonstrated_phase(movement: Movement) -> PhaseRule:
    """Find it by the demonstrations' mean and spread: for movements without any."""
    demonstrated = EmpiricalDistribution(movement.aligned)
    return PathPhase(demonstrated, movement.aligned, _PATH_PHASE)


def clock_phase(movement: Movement) -> PhaseRule:
    """Take the phase of the command: the paper's time."""
    return ClockPhase()


def profile_of_spread(
    aligned: AlignedDemonstrations, resolution: tuple[float, float] = (1e-4, 3e-2)
) -> StiffnessProfile:
    """Scale the stiffness profile by the demonstrations' spread, root mean square.

    ``resolution`` is the residual pose uncertainty after a long observation [m, rad].
    Tuned; another one by ``functools.partial``.
    """
    poses = aligned.demonstrated.poses
    if len(poses) < 2:
        return DEFAULT_PROFILE
    spread = np.sqrt(poses.var(axis=0, ddof=1).mean(axis=0))
    return spread_profile(spread, np.repeat(resolution, 3))


@dataclass(frozen=True, kw_only=True, slots=True)
class FixedProfile:
    """One stiffness law for every task."""

    profile: StiffnessProfile
    """The law."""

    def __call__(self, aligned: AlignedDemonstrations) -> StiffnessProfile:
        """Return the law."""
        return self.profile


@dataclass(frozen=True, kw_only=True, slots=True)
class Method:
    """Everything that makes a method what it is; called, it learns and follows.

    A method can be pickled if its functions can: make variants with
    `dataclasses.replace` and `functools.partial`.
    """

    fit: Callable[..., Movement]
    """Learns a movement from `AlignedDemonstrations`."""
    fit_forces: Callable[..., Movement] | None = None
    """Learns forces where `fit` takes outputs for poses; None for `fit`."""
    seeded: bool = False
    """Whether learning draws random numbers: `fit` then also takes ``seed=``."""
    accepts_prior_mean: bool = False
    """Whether it can learn around a prior mean: `fit` then also takes
    ``centred=False``, for a prior mean of zero."""
    align: Callable[[Sequence[Demonstration]], AlignedDemonstrations] = align
    """Brings demonstrations onto common phases."""
    beyond: float = 0.0
    """Share of the demonstrated path by which the motion goes on where demonstrations
    end, ever less certain; 0 for none."""
    adaptation: AdaptationForm | None = None
    """In which form via-points adapt the movement; None for a method without."""
    door_adaptation: AdaptationForm | None = None
    """In which form they do while an agent follows it on doors, whose paths differ in
    size; None for `adaptation`."""
    force_adaptation: AdaptationForm | None = None
    """In which form forces measured on a door adapt what is expected of them; None for
    `adaptation`."""
    phases: Callable[[Movement], PhaseRule] = path_phase
    """How an agent finds where along the task the hand is."""
    profile: Callable[[AlignedDemonstrations], StiffnessProfile] = profile_of_spread
    """Which stiffness has which uncertainty; it takes the place of the config's."""
    phase_stiffness: Callable[[Movement, StiffnessProfile], PhaseStiffness] | None = (
        None
    )
    """Which stiffness demonstrated forces give in addition, such as
    `gplfd_policies.control.phase_stiffness.demonstrated_stiffness`; None for none."""
    config: ComplianceConfig = field(default_factory=ComplianceConfig)
    """How it follows the movement otherwise: load, timing, via-points."""
    handle_config: HandleConfig = field(default_factory=HandleConfig)
    """When and how far a handle is turned beyond the demonstrated turn."""
    modes: ModeConfig | None = None
    """When a mode is given up where the demonstrations have several, which are found
    and learned one by one; None learns all demonstrations as one."""
    correct: Callable[["Method", Movement, Correction], Movement] | None = None
    """Learns from a correction: takes this method, a movement and the correction, and
    returns another movement, such as
    `gplfd_policies.registry.corrections.add_correction`; None for a method that cannot
    be corrected."""

    def __post_init__(self) -> None:
        if self.config.profile is not DEFAULT_PROFILE:
            raise ValueError(
                "Method.config has a profile, which Method.profile would replace; give "
                "it as Method(profile=FixedProfile(profile=...))"
            )

    @one_thread
    def learn(self, training: TrainingInput) -> Movement:
        """Learn a movement, around the prior mean if one is given.

        The demonstrations may be of any task and in any frame that they share.

        Raises:
            ValueError: There is no demonstration, or the method takes no prior mean
                and one is given.
        """
        prior_mean = training.prior_mean
        if prior_mean is not None and not self.accepts_prior_mean:
            raise ValueError("this method has no prior mean that could be given")
        if not training.demonstrations:
            raise ValueError(
                "no demonstrations were given; a policy needs at least one"
            )
        shown = self.align(training.demonstrations)
        aligned = continued(shown, self.beyond)
        fit = partial(self.fit, seed=training.seed) if self.seeded else self.fit
        if prior_mean is None:
            movement = fit(aligned)
        else:
            longer = Stretched(of=prior_mean, factor=1.0 / aligned.end)
            movement = fit_residual(aligned, longer, partial(fit, centred=False))
        forces = aligned.forces
        if forces is None or not isinstance(movement, LearnedMovement):
            return movement
        with warnings.catch_warnings():
            # Of too few demonstrations: the motion has warned already.
            warnings.simplefilter("ignore", UserWarning)
            return replace(movement, forces=(self.fit_forces or fit)(forces))

    @one_thread
    def learn_modes(self, training: TrainingInput) -> "tuple[LearnedMode, ...]":
        """Learn a movement of every mode of the demonstrations, the largest mode first.

        Raises what `learn` does.
        """
        given = training.demonstrations
        modes: tuple[tuple[int, ...], ...] = (tuple(range(len(given))),)
        if self.modes is not None and len(given) > 1:
            with warnings.catch_warnings():
                # Learning aligns them again, and warns.
                warnings.simplefilter("ignore", UserWarning)
                modes = partition(self.align(given))
        each = [replace(training, demonstrations=[given[n] for n in m]) for m in modes]
        return tuple(
            LearnedMode(numbers=numbers, movement=self.learn(shown))
            for numbers, shown in zip(modes, each, strict=True)
        )

    def update(self, movement: Movement, correction: Correction) -> Movement:
        """Return a movement that has learned from a correction; the given one stays.

        Raises:
            ValueError: The method cannot be corrected.
        """
        if self.correct is None:
            raise ValueError(
                "this policy cannot be corrected: its Method has no `correct`, which "
                "learns from a correction"
            )
        return self.correct(self, movement, correction)

    @one_thread
    def follow(self, movement: Movement) -> CompliantAgent:
        """Return an agent that follows a movement on doors; any number from one.

        Raises:
            ValueError: The demonstrations that it was learned from do not begin at the
                closed handle, are not in metres, or lack wrenches that it needs.
        """
        _check_starts(movement.aligned.demonstrated.poses)
        profile, learned = self.profile(movement.aligned), self.phase_stiffness
        return CompliantAgent(
            GriddedMovement(movement, self.door_adaptation or self.adaptation, _GRID),
            phases=self.phases(movement),
            config=replace(
                self.config,
                profile=profile,
                phase_stiffness=learned and learned(movement, profile),
            ),
            handle_config=self.handle_config,
            forces=self._follow_forces(movement),
        )

    def follow_modes(
        self, modes: "Sequence[LearnedMode]"
    ) -> CompliantAgent | ModesAgent:
        """Return an agent that follows the movement, or tries those of several modes.

        Raises what `follow` does.
        """
        agents = [self.follow(mode.movement) for mode in modes]
        if self.modes is None or len(agents) == 1:
            return agents[0]
        return ModesAgent(agents, [len(mode.numbers) for mode in modes], self.modes)

    def _follow_forces(self, movement: Movement) -> GriddedMovement | None:
        learned = movement.forces if isinstance(movement, LearnedMovement) else None
        if learned is None:
            return None
        # How repetitions differ is unknown of a single one.
        alone = len(learned.aligned.poses) < 2
        form = None if alone else self.force_adaptation or self.adaptation
        return GriddedMovement(learned, form, _GRID)

    def __call__(self, training: TrainingInput) -> CompliantAgent | ModesAgent:
        """Learn a movement and follow it on doors; raises what both do."""
        _check_starts(one.poses for one in training.demonstrations)
        return self.follow_modes(self.learn_modes(training))


@dataclass(frozen=True, kw_only=True, slots=True)
class LearnedMode:
    """What was learned of one mode."""

    numbers: tuple[int, ...]
    """Numbers of the demonstrations that show it."""
    movement: Movement
    """What was learned of those."""


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
                "pull, y up); demonstration.relative_to_first() gives the motion in "
                "the axes of its first pose, which must then be these; `gplfd demos "
                "import --frame hinge` finds them from the motion"
            )
