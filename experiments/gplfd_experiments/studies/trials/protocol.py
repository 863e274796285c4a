"""Protocol v9: trials, policies, and rules for contrasts.

The trials are in ``protocol.toml``. The protocol is frozen under its version: a change
of a door, a draw, a demonstration, a measure or a policy that takes part makes another
version. The criteria were settled before the trials were run.

All random draws of a seed are equal for all policies, so policies are compared per
seed. A policy's number is its mean over the doors and levels of a seed. For the
differences of two policies, the Hodges-Lehmann estimate is given with its exact 95 %
interval (signed ranks). An idea shows in a contrast if the interval excludes zero on
the side of the policy with the idea. With ten seeds an effect as large as the
differences' standard deviation is found in 78 of 100 repetitions, one 1.2 times as
large in 90 (1,500 simulated each).
"""

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

from gplfd_experiments.studies.trials.records import Contrast, Level, Side, Trial
from gplfd_policies.registry.built_in import TABLE_1, tuned_settings

VERSION: Final = 9
"""Of the protocol."""

SEEDS: Final = 10
"""Number of seeds of every trial."""

REFERENCES: Final = ("hinge-fit", "reflex", "chord", "compliant-pull", "oracle")
"""Policies that learn nothing from a demonstration, as a baseline."""

EVERYWHERE: Final = (*TABLE_1, "tp-gmm", *REFERENCES)
"""Policies that take part in every trial."""

TUNED: Final = tuple(f"{name}-tuned" for name in tuned_settings())
"""Methods with settings by tuning. They take part in trials of the whole protocol
in which learning decides; of the controller, which decides the other trials, only the
resolution of the stiffness law is chosen for each method."""

ProtocolPart = Literal["whole", "ideas", "small"]
"""Of the protocol."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PartPlan:
    """Number of seeds, and the policies of every trial, of a part of the protocol."""

    seeds: int
    everywhere: tuple[str, ...]
    variants: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Variants of `gp` that lack an idea, by trial; other trials have all of their
    variants."""


PARTS: Final[Mapping[ProtocolPart, PartPlan]] = MappingProxyType(
    {
        "whole": PartPlan(seeds=SEEDS, everywhere=EVERYWHERE),
        "ideas": PartPlan(seeds=SEEDS, everywhere=("gp", "hinge-fit")),
        "small": PartPlan(
            seeds=6,
            everywhere=("gp", "hinge-fit"),
            variants={
                "radius": ("gp-fixed",),
                "turned": ("gp-position-only",),
                "person": ("gp-constant-500", "gp-carried-load"),
                "locked": ("gp-constant-500", "gp-carried-load"),
                "heavy": ("gp-constant-100", "gp-carried-load"),
            },
        ),
    }
)
"""The parts by name. Contrasts of "ideas" are decided as in the whole protocol. The
small part is a first look at the strongest contrasts of docs/results/trials-v9.json,
with the smallest number of seeds that gives an interval; it decides nothing."""

CONSTANT: Final = tuple(f"gp-constant-{k}" for k in (100, 500))
"""`gp` at constant stiffnesses."""

_LACKING: Final[Mapping[str, tuple[str, ...]]] = {
    "via-points": ("gp-fixed",),
    "size and phase together": ("gp-one-size",),
    "forecast with size": ("gp-process",),
    "progress beyond the demonstrations": ("gp-within-demonstrations",),
    "task variability": ("gp-homoscedastic",),
    "heteroscedastic noise": ("gp-homoscedastic",),
    "rotations": ("gp-position-only",),
    "variable stiffness": CONSTANT,
    "learned load": ("gp-carried-load",),
    "demonstrated forces": ("gp-without-forces",),
    "damping for contact": ("gp-undamped",),
    "several modes": ("gp-one-mode",),
}
"""Variants of `gp` that lack an idea."""


def _contrasts(
    measure: str,
    ideas: Sequence[str],
    level: str = "",
    having: str = "",
    lacking: str = "",
) -> Iterator[Contrast]:
    """Compare two levels of `gp`, or `gp` with the variants that lack an idea."""
    for idea in ideas:
        for policy in ("gp",) if having else _LACKING[idea]:
            yield Contrast(
                idea=idea,
                measure=measure,
                having=Side(policy="gp", level=having or level),
                lacking=Side(policy=policy, level=lacking or level),
            )


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
        compared = trial.pop("contrasts", [])
        group = trial.pop("only_policies", "")
        yield (
            name,
            Trial(
                levels=levels,
                contrasts=tuple(c for row in compared for c in _contrasts(**row)),
                only_policies=protocol["policies"].get(group, ()),
                **trial,
            ),
        )


TRIALS: Final[Mapping[str, Trial]] = MappingProxyType(
    dict(
        _trials(
            tomllib.loads(Path(__file__).with_name("protocol.toml").read_text("utf-8"))
        )
    )
)
"""Every trial by its name."""

TIERS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "furniture": ("radius", "further", "few", "messy", "rests", "turned", "heavy"),
        "buildings": ("buildings",),
        "other motions": ("motions",),
        "realistic conditions": (
            *("handle-pose", "two-modes", "few-doors", "another-handle"),
        ),
        "forces": (
            *("forces-weight", "forces-closer", "forces-person"),
            *("forces-blocked", "forces-seal"),
        ),
    }
)
"""Names of trials by tier. The tier furniture has the trials of protocol v2 in which
the share of opened doors separates pairs of methods other than `gp-paper` (signed ranks
of 20 seeds, Holm, 5 %). A tier without trials is not run yet."""
