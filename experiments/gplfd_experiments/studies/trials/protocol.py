"""Protocol v9: trials, policies, and rules for contrasts.

Frozen under its version: a change of a door, a draw, a demonstration, a measure or a
policy that takes part makes another version. The criteria were settled before the
trials were run.

All random draws of a seed are equal for all policies, so policies are compared per
seed. A policy's number is its mean over the doors and levels of a seed. For the
differences of two policies, the Hodges-Lehmann estimate is given with its exact 95 %
interval (signed ranks). An idea shows in a contrast if the interval excludes zero on
the side of the policy with the idea. With ten seeds an effect as large as the
differences' standard deviation is found in 78 of 100 repetitions, one 1.2 times as
large in 90 (1,500 simulated each).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final, Literal

from gplfd_experiments.studies.trials.forces import FORCES
from gplfd_experiments.studies.trials.furniture import FURNITURE
from gplfd_experiments.studies.trials.other_doors import OTHER_DOORS
from gplfd_experiments.studies.trials.records import Trial
from gplfd_policies.registry.built_in import TABLE_1
from gplfd_policies.registry.tuning_spaces import tuned_settings

VERSION: Final = 9
"""Of the protocol."""

SEEDS: Final = 10
"""Seeds of every trial: 0, 1, ... Independent episodes needed to separate two shares of
opened doors (power 0.8): 24 for 0.9 and 0.4, 84 for 0.85 and
0.6."""

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

TRIALS: Final[Mapping[str, Trial]] = MappingProxyType(
    {**FURNITURE, **OTHER_DOORS, **FORCES}
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
