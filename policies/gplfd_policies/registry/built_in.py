"""The policies of this project by name, with the settings in their entries."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gplfd_policies.adaptation import (
    ForceAdaptation,
    OwnAdaptation,
    ProcessAdaptation,
    ProductAdaptation,
    SimilarityAdaptation,
)
from gplfd_policies.agents.model_based.hinge_fit import HingeFitAgent
from gplfd_policies.agents.model_based.mechanism_fit import MechanismFitAgent
from gplfd_policies.agents.model_based.oracle import OracleAgent, ToldHandleAgent
from gplfd_policies.agents.model_based.pulling import (
    ChordAgent,
    CompliantPullAgent,
    ReflexAgent,
)
from gplfd_policies.agents.modes import ModeConfig
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import CarriedLoad, YieldToAll
from gplfd_policies.control.phase_stiffness import stiffness_from_force
from gplfd_policies.control.rendering import ARM_DYNAMICS, ArmRendering
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
)
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.path_similarity import SimilarityConfig
from gplfd_policies.movements.baselines.dmp import fit_dmp
from gplfd_policies.movements.baselines.gmm_gp import fit_gmm_gp
from gplfd_policies.movements.baselines.gmr import fit_gmr
from gplfd_policies.movements.baselines.kmp import KMPConfig, fit_kmp
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig, fit_local_gp
from gplfd_policies.movements.baselines.midigap import fit_midigap
from gplfd_policies.movements.baselines.prodmp import fit_prodmp
from gplfd_policies.movements.baselines.promp import fit_promp
from gplfd_policies.movements.baselines.tp_gmm import fit_tp_gmm
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.phase.path_phase import PathPhaseConfig
from gplfd_policies.registry.corrections import add_correction
from gplfd_policies.registry.method import (
    Method,
    Policy,
    TrainingInput,
    demonstrated_phase,
    path_phase,
    profile_of_spread,
)


def _positions_alone(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    """Align demonstrations without their rotations."""
    still = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    return align(
        [
            replace(demonstration, poses=demonstration.poses * still)
            for demonstration in demonstrations
        ]
    )


GP: Final = Method(
    fit=fit_skill,
    accepts_prior_mean=True,
    beyond=0.5,
    adaptation=ProcessAdaptation,
    door_adaptation=SimilarityAdaptation,
    force_adaptation=ForceAdaptation,
    modes=ModeConfig(),
    correct=add_correction,
)
"""The method of this project; each ablation differs from it in one field."""

PAPER: Final = Method(
    fit=partial(fit_skill, noise="kersting"),
    accepts_prior_mean=True,
    # DTW on the raw completion index of the whole recording.
    align=partial(align, method="dtw", denoise=False, trim_rests=False),
    adaptation=partial(ProductAdaptation, prior_mean="zero"),
    # The same stiffness function for all axes, the whole wrench in Eq. (22), no limit
    # of the lead. Where the paper gives no details, ours are used: the phase of an
    # observation and its via-point noise (with the clock time, no door opens), and
    # the governor instead of hand tuning.
    profile=PAPER_PROFILE,
    config=ComplianceConfig(
        load=YieldToAll(),
        dynamics=PAPER_DYNAMICS,
        stiffness_frame="axes",
        max_turn_lead=1.0,
    ),
)
"""The method as the paper states it."""

UNDAMPED: Final = replace(DEFAULT_DYNAMICS, least_damping=np.zeros(6))
"""Only critical damping: stable in free motion, but not in contact with a delay."""

DOOR_KMP: Final = KMPConfig(mean_regularisation=1.0, covariance_regularisation=400.0)
"""λ as published, and λ_c = N, with which the prior variance is that of the
demonstrations. The published λ_c of 60 is for letters in centimetres. Converted to
standardised outputs, both published values give too narrow intervals here and pull the
mean 5 cm inwards."""

ONE_SIZE: Final = PathPhaseConfig(
    similarity=SimilarityConfig(size_std=0.0, size_weight=1e9)
)
"""Assumes that every door has the demonstrations' mean size."""

TABLE_1: Final = (
    *("dmp", "promp", "gmr", "local-gp", "wishart-gp", "kmp", "gmm-gp"),
    *("gp-paper", "gp"),
)
"""The methods of the paper's Table 1, the paper's own and ours."""


def _motion_only(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    """Align demonstrations and leave out their forces."""
    return replace(align(demonstrations), wrenches=None)


def _ablation(summary: str, **changes: Any) -> Policy:
    """Return `GP` with other fields."""
    return Policy(summary=summary, make=replace(GP, **changes), kind="ablation")


def _constant(translation: int, end: str) -> Policy:
    """Return `GP` with constant stiffness [N/m], in rotation a tenth [N m/rad]."""
    constant = np.repeat([float(translation), 0.1 * translation], 3)
    return _ablation(
        f"gp with constant stiffness of {translation} N/m (its {end})",
        profile=replace(DEFAULT_PROFILE, k_min=constant, k_max=constant),
    )


def _method(
    summary: str,
    fit: Callable[..., Movement],
    *,
    resolution: float | None = None,
    **fields: Any,
) -> Policy:
    """Return a method; its stiffness law may have another resolution than gp's [m].

    The resolutions of all methods were chosen by one criterion and budget, see
    "The resolution of the stiffness law" in docs/comparison.md.
    """
    if resolution is not None:
        profile = partial(profile_of_spread, resolution=(resolution, 3e-2))
        fields["profile"] = profile
    return Policy(summary=summary, make=Method(fit=fit, **fields))


def _untaught(agent: Callable[[], object], training: TrainingInput) -> object:
    return agent()


def _model_based(
    agent: Callable[[], object], summary: str, *, told: bool = False
) -> Policy:
    make = partial(_untaught, agent)
    return Policy(summary=summary, make=make, kind="reference", told=told)


AS_PUBLISHED: Final[Mapping[str, Policy]] = MappingProxyType(
    {
        "gp": Policy(
            summary="heteroscedastic GP with online adaptation and variable stiffness",
            make=GP,
        ),
        "gp-process": _ablation(
            "gp whose forecast infers no size: outputs deviate as demonstrated",
            door_adaptation=None,
        ),
        "gp-fixed": _ablation(
            "gp without adaptation (follows the mean of the demonstrations)",
            adaptation=None,
            door_adaptation=None,
            force_adaptation=None,
        ),
        "gp-homoscedastic": _ablation(
            "gp with one noise level for the whole motion (homoscedastic)",
            fit=partial(fit_skill, noise="homoscedastic"),
        ),
        "gp-one-size": _ablation(
            "gp that assumes the demonstrations' mean size for every path",
            phases=partial(path_phase, config=ONE_SIZE),
        ),
        "gp-position-only": _ablation(
            "gp that learns positions only (constant orientation)",
            align=_positions_alone,
        ),
        "gp-carried-load": _ablation(
            "gp that compensates loads of up to 25 N along the path",
            config=ComplianceConfig(load=CarriedLoad()),
        ),
        "gp-undamped": _ablation(
            "gp without the additional damping for contact",
            config=ComplianceConfig(dynamics=UNDAMPED),
        ),
        "gp-without-forces": _ablation(
            "gp without learning of the demonstrated forces", align=_motion_only
        ),
        "gp-one-mode": _ablation(
            "gp that learns demonstrations of all kinds as one", modes=None
        ),
        "gp-within-demonstrations": _ablation(
            "gp that stops where the demonstrations end", beyond=0.0
        ),
        "gp-paper": Policy(
            summary="the paper's method (Kersting noise, product of Gaussians)",
            make=PAPER,
        ),
        "gp-constant-100": _constant(100, "minimum"),
        "gp-constant-500": _constant(500, "maximum"),
        "gp-impedance": Policy(
            summary="gp with stiffness realised by the arm's impedance control",
            make=replace(
                GP,
                config=ComplianceConfig(
                    rendering=ArmRendering,
                    dynamics=ARM_DYNAMICS,
                    stiffness_frame="axes",
                ),
            ),
        ),
        "stiffness-from-force": Policy(
            summary="gp's motion; soft along the demonstrated force, stiff across it",
            make=replace(GP, phase_stiffness=stiffness_from_force),
        ),
        "dmp": _method(
            "dynamic movement primitive; no uncertainty, no via-points",
            fit_dmp,
            phases=demonstrated_phase,
        ),
        "promp": _method(
            "probabilistic movement primitive with online conditioning",
            fit_promp,
            adaptation=OwnAdaptation,
            resolution=3e-4,
        ),
        "gmr": _method("Gaussian-mixture regression; no via-points", fit_gmr),
        "tp-gmm": _method(
            "task-parameterised mixture, frames at handle and estimated hinge",
            fit_tp_gmm,
            adaptation=OwnAdaptation,
            resolution=3e-3,
        ),
        "local-gp": _method(
            "local Gaussian processes (reconstruction); no via-points",
            partial(fit_local_gp, config=LocalGPConfig()),
            accepts_prior_mean=True,
            resolution=3e-3,
        ),
        "wishart-gp": _method(
            "GP, Wishart-process covariance (reconstruction); no via-points",
            partial(fit_wishart_gp, config=WishartGPConfig()),
            seeded=True,
            accepts_prior_mean=True,
            resolution=3e-3,
        ),
        "kmp": _method(
            "kernelised movement primitive, regularisation tuned for doors",
            partial(fit_kmp, config=DOOR_KMP),
            adaptation=OwnAdaptation,
            resolution=1e-3,
        ),
        "kmp-published": _method(
            "kernelised movement primitive with the published regularisation",
            fit_kmp,
            adaptation=OwnAdaptation,
        ),
        "gmm-gp": _method(
            "GP with a Gaussian-mixture prior and online conditioning",
            fit_gmm_gp,
            adaptation=OwnAdaptation,
            resolution=3e-3,
        ),
        "prodmp": _method(
            "probabilistic dynamic movement primitive with online conditioning",
            fit_prodmp,
            adaptation=OwnAdaptation,
        ),
        "midigap": _method(
            "mixture of discrete-time Gaussian processes (reconstruction); modes",
            fit_midigap,
            fit_forces=fit_promp,
            adaptation=OwnAdaptation,
            resolution=3e-4,
        ),
        "hinge-fit": _model_based(
            HingeFitAgent, "estimates the hinge from the hand's path; compliant"
        ),
        "hinge-fit-told": _model_based(
            ToldHandleAgent,
            "knows the handle and turns it, then acts as hinge-fit",
            told=True,
        ),
        "mechanism-fit": _model_based(
            MechanismFitAgent, "finds the kind of mechanism from the hand's path"
        ),
        "reflex": _model_based(
            ReflexAgent, "moves in the last direction of motion; compliant across it"
        ),
        "chord": _model_based(ChordAgent, "pulls in the last direction of motion"),
        "compliant-pull": _model_based(
            CompliantPullAgent, "pulls straight back with a constant force; compliant"
        ),
        "oracle": _model_based(
            OracleAgent, "knows the door and follows its exact arc; stiff", told=True
        ),
    }
)
"""Policies with the settings in their entries."""
