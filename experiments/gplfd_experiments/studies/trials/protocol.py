"""Protocol 1.1: trials, policies, and rules for contrasts.

The trials are in ``protocol.toml``. A change of a door, a draw, a measure or a policy
that takes part makes another version; docs/protocol.md has criteria and statistics.
All random draws of a seed are equal for all policies, which are compared per seed by
their mean over levels, and over the doors of a level.
"""

import itertools
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from gplfd_env.conventions.constants import Start
from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, standard_teacher
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.studies.sources import chosen, policy_fields


@dataclass(frozen=True, kw_only=True, slots=True)
class Level:
    """One setting of a trial; other fields are as in `episodes.task.EpisodeTask`."""

    doors: tuple[str, ...]
    """Names of doors, or radii [m] as text."""
    door: Mapping[str, Any] = field(default_factory=dict)
    """Fields of every door's configuration that differ from the preset."""
    randomization: str | Mapping[str, Any] = "none"
    disturbance: str | Mapping[str, Any] = "none"
    demonstrated_radii: tuple[float, ...] | None = DEMONSTRATED_RADII
    """None: those of the three demonstrated doors for a door of this kind."""
    demonstrated_kind: Mapping[str, str] | None = None
    """None: the kind of the opened door."""
    demonstrated_hardware: tuple[Mapping[str, Any], ...] = ()
    start: Start = "grasped"
    demonstrations_per_door: int = 2
    teacher: Mapping[str, float] = field(default_factory=dict)
    """Fields of the teacher that differ from the standard one."""
    habits: Mapping[str, Any] | None = None
    demonstrated_forces: bool = False
    prior_radius: float | None = None
    """Only methods that accept a prior mean take part."""
    corrections: int = 0
    """Before the episode; with any, only policies that can be corrected take part."""
    demonstrated: bool = False
    """As in `gplfd_experiments.episodes.leading.Practice`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Side:
    """A policy at a level of a trial; at all levels together by default."""

    policy: str
    level: str = ""

    def __str__(self) -> str:
        return f"{self.policy}, {self.level}" if self.level else self.policy


@dataclass(frozen=True, kw_only=True, slots=True)
class Contrast:
    """Comparison by a measure of two policies that differ only in one idea."""

    idea: str
    measure: str
    having: Side
    lacking: Side


@dataclass(frozen=True, kw_only=True, slots=True)
class Trial:
    """A question that episodes answer."""

    question: str
    levels: Mapping[str, Level]
    """Settings by name, in the order in which they are shown."""
    measures: Sequence[str] = ("success", "force_handle_peak")
    """Metrics of episodes that answer it, the deciding one first."""
    contrasts: tuple[Contrast, ...] = ()
    """Contrasts that this trial decides."""
    extra_policies: Sequence[str] = ()
    """Policies that take part besides those of its tracks and of the contrasts."""

    @property
    def own(self) -> tuple[str, ...]:
        """Policies of this trial, besides those of its tracks."""
        lacking = (contrast.lacking.policy for contrast in self.contrasts)
        return (*lacking, *self.extra_policies)


@dataclass(frozen=True, kw_only=True, slots=True)
class Track:
    """Trials that answer one kind of question, and the policies that take part."""

    trials: Sequence[str]
    policies: Sequence[str]


VERSION: Final = "1.1"
"""Of the protocol."""

SEEDS: Final = 20
"""Number of seeds of every trial."""

FIRST_SEED: Final = 100
"""The agent and its constants grew on the doors of earlier seeds."""

REFERENCES: Final = ("hinge-fit", "mechanism-fit", "oracle")
"""Policies that learn nothing from a demonstration, as a baseline."""

ProtocolPart = Literal["whole", "ideas", "small"]
"""Of the protocol."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PartPlan:
    """Number of seeds, and the policies of every trial, of a part of the protocol."""

    seeds: int = SEEDS
    everywhere: Sequence[str] = ()
    """Without any, those of its tracks."""
    variants: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Variants of `gp` that lack an idea, by trial; other trials have all of theirs."""


def _trials(protocol: Mapping[str, Any]) -> Iterator[tuple[str, Trial]]:
    """Yield the trials of the file by name."""
    for name, entries in protocol["trials"].items():
        trial = dict(entries)
        shared = trial.pop("every", {})
        levels: dict[str, Level] = {}
        for title, entry in trial.pop("levels").items():
            fields = shared | entry
            if fields.pop("like_opened", False):
                fields["demonstrated_radii"] = None
            if "shape" in fields:
                fields["door"] = protocol["shapes"][fields.pop("shape")]
            levels[title] = Level(**fields)
        # Two levels of `gp`, or `gp` with the variants that lack an idea.
        contrasts = [
            Contrast(
                idea=idea,
                measure=row["measure"],
                having=Side(policy="gp", level=row.get("having", row.get("level", ""))),
                lacking=Side(policy=p, level=row.get("lacking", row.get("level", ""))),
            )
            for row in trial.pop("contrasts", [])
            for idea in row["ideas"]
            for p in (("gp",) if "having" in row else protocol["lacking"][idea])
        ]
        yield name, Trial(levels=levels, contrasts=tuple(contrasts), **trial)


_FILE: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
TRIALS: Final[Mapping[str, Trial]] = dict(_trials(_FILE))
"""Every trial by its name."""

TRACKS: Final[Mapping[str, Track]] = {
    name: Track(**track) for name, track in _FILE["tracks"].items()
}
"""Every track by its name."""

PARTS: Final = {name: PartPlan(**part) for name, part in _FILE["parts"].items()}
"""The parts by name. "ideas" decides its contrasts as the whole protocol does. "small",
with the fewest seeds that give an interval, is a first look at strong contrasts."""


def taking_part(trial: str) -> tuple[str, ...]:
    """Return the policies of a trial in the whole protocol."""
    tracks = [track.policies for track in TRACKS.values() if trial in track.trials]
    return tuple(dict.fromkeys((*itertools.chain(*tracks), *TRIALS[trial].own)))


def named_trials(
    names: Sequence[str], part: ProtocolPart = "whole"
) -> dict[str, Trial]:
    """Return trials by name; without names, all trials of a part of the protocol."""
    for name in names:
        if name not in TRIALS:
            raise ValueError(
                f"unknown trial {name!r}{nearest_name(name, TRIALS)}; trials: "
                f"{', '.join(TRIALS)}"
            )
        if list(names).count(name) > 1:
            raise ValueError(f"trial {name} is given twice")
    return {name: TRIALS[name] for name in names or PARTS[part].variants or TRIALS}


_PLAIN: Final = (
    *("demonstrations_per_door", "randomization", "disturbance", "start", "habits"),
    *("demonstrated_forces", "prior_radius"),
)  # Fields of a level that a task has, too.


def trial_tasks(
    trials: dict[str, Trial],
    *,
    policies: Sequence[str] = (),
    part: ProtocolPart = "whole",
    only: Sequence[str] = (),
    seeds: int | None = None,
    first_seed: int = FIRST_SEED,
    robot: str = "tiago-like",
    taught_by: Literal["first", "second"] = "first",
) -> tuple[EpisodeTask, ...]:
    """Return the episodes of trials; the seed varies slowest.

    ``only`` replaces the policies, without levels in which one of them cannot take
    part; their sources are then left out. ``seeds`` replaces the number of seeds of the
    part. Another `robot` opens, another synthetic human demonstrates the same doors.
    """
    plan = PARTS[part]
    doors = {
        (name, title): {
            door: config.replaced(level.door)
            for door, config in named_doors(level.doors, robot=robot).items()
        }
        for name, trial in trials.items()
        for title, level in trial.levels.items()
    }
    tasks: list[EpisodeTask] = []
    numbers = range(first_seed, first_seed + (seeds or plan.seeds))
    for seed, (name, trial) in itertools.product(numbers, trials.items()):
        variants = plan.variants.get(name, trial.own)
        everywhere = plan.everywhere or taking_part(name)
        competing = (*everywhere, *variants, *policies)
        every = dict.fromkeys(only or competing)
        for policy, (title, level) in itertools.product(every, trial.levels.items()):
            rivals = [chosen(rival) for rival in only or (policy,)]
            informed = level.prior_radius is not None
            if (informed and not all(rival.accepts_prior_mean for rival in rivals)) or (
                level.corrections and not all(rival.learns for rival in rivals)
            ):
                continue
            opened = doors[name, title]
            fields: dict[str, Any] = {field: getattr(level, field) for field in _PLAIN}
            if level.demonstrated_radii is not None:
                fields["demonstrated_radii"] = level.demonstrated_radii
                fields["demonstrated_hardware"] = level.demonstrated_hardware
            if level.demonstrated_kind is not None:
                fields["demonstrated_kind"] = level.demonstrated_kind
            if level.corrections:
                fields["practice"] = {
                    "corrections": level.corrections,
                    "doors": [config.as_dict() for config in opened.values()],
                    "randomization": level.randomization,
                    "demonstrated": level.demonstrated,
                }
            tasks += [
                episode_task(
                    door,
                    config,
                    **({"policy": policy} if only else policy_fields(policy)),
                    seed=seed,
                    teacher=standard_teacher() | dict(level.teacher),
                    robot=robot,
                    taught_by=taught_by,
                    trial=name,
                    level=title,
                    **fields,
                )
                for door, config in opened.items()
            ]
    return tuple(tasks)
