"""The policies of this project by name, their settings, and spaces for tuning them.

Each method has a space of the settings that its authors would tune, with plausible
limits, which ``benchmarks/tune.py`` searches. The best settings found are stored in
``tuned.json`` and registered as ``<name>-tuned``. The controller is the same for all
and not included, but for the resolution of its stiffness law.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from gplfd_policies.adaptation import OwnAdaptation
from gplfd_policies.adaptation.process import ForceAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.adaptation.similarity import SimilarityAdaptation
from gplfd_policies.agents.model_based.following import (
    ChordAgent,
    CompliantPullAgent,
    HingeFitAgent,
    ReflexAgent,
)
from gplfd_policies.agents.model_based.mechanism import MechanismFitAgent
from gplfd_policies.agents.model_based.oracle import OracleAgent, ToldHandleAgent
from gplfd_policies.agents.modes import ModeConfig
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import CarriedLoad, YieldToAll
from gplfd_policies.control.rendering import ARM_DYNAMICS, ArmRendering
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
    StiffnessProfile,
    stiffness_from_force,
)
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.path_similarity import SimilarityConfig
from gplfd_policies.gp.heteroscedastic import KerstingNoise, MapNoise
from gplfd_policies.movements.baselines.dmp import DMPConfig, fit_dmp
from gplfd_policies.movements.baselines.gmm_gp import GMMGPConfig, fit_gmm_gp
from gplfd_policies.movements.baselines.gmr import GMRConfig, fit_gmr
from gplfd_policies.movements.baselines.kmp import KMPConfig, fit_kmp
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig, fit_local_gp
from gplfd_policies.movements.baselines.midigap import MiDiGaPConfig, fit_midigap
from gplfd_policies.movements.baselines.prodmp import ProDMPConfig, fit_prodmp
from gplfd_policies.movements.baselines.promp import ProMPConfig, fit_promp
from gplfd_policies.movements.baselines.tp_gmm import fit_tp_gmm
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.phase.phase_rule import PathPhaseConfig
from gplfd_policies.registry.method import (
    Method,
    Policy,
    TrainingInput,
    add_correction,
    demonstrated_phase,
    path_phase,
    profile_of_spread,
)


def _positions_alone(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    """Align demonstrations without their rotations."""
    still = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    return align(
        [replace(motion, poses=motion.poses * still) for motion in demonstrations]
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
    # Where the paper gives no details, ours are used: the phase of an observation and
    # its via-point noise (with the clock time, no door opens), and the governor.
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
demonstrations; the published values are for letters in centimetres."""

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


Value = bool | int | float
Values = Mapping[str, Value]


class Setting(NamedTuple):
    """One number or choice: published value, least and greatest, and its scale."""

    published: Value
    low: Value
    high: Value
    logarithmic: bool = False


class Space:
    """The settings of a method by name, which are arguments of ``config``.

    Only ``via_std_factor``, which multiplies the standard deviation of via-points, does
    not belong to the fit.

    Args:
        config: Makes the configuration of the fit from the settings.
        argument: Name of the fit's argument for this configuration.
        resolution: Resolution of the stiffness law with the tuned settings [m].
        settings: Settings by name.
    """

    def __init__(
        self,
        config: Callable[..., object],
        argument: str = "config",
        *,
        resolution: float = 1e-4,
        **settings: Setting,
    ) -> None:
        self.config, self.argument = config, argument
        self.resolution, self.settings = resolution, settings

    @property
    def published(self) -> Values:
        """The settings with which the method is registered."""
        return {name: setting.published for name, setting in self.settings.items()}


_log = partial(Setting, logarithmic=True)

_VIA_STD_FACTOR: Final = _log(1.0, 0.2, 10.0)
"""Factor on the via-point noise of 1 mm, 0.03 rad, for every method with via-points."""

_MIXTURE: Final[Mapping[str, Any]] = {
    "components": Setting(10, 3, 20),
    "regularisation": _log(4e-6, 1e-7, 1e-2),
}

SPACES: Final[Mapping[str, Space]] = MappingProxyType(
    {
        "dmp": Space(
            DMPConfig,
            resolution=3e-4,
            n_basis=Setting(30, 10, 60),
            alpha=_log(25.0, 10.0, 60.0),
            spread=Setting(False, False, True),
        ),
        "promp": Space(
            ProMPConfig,
            n_basis=Setting(20, 8, 40),
            overlap=Setting(0.7, 0.3, 0.95),
            shrinkage=_log(1e-6, 1e-8, 0.5),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gmr": Space(GMRConfig, resolution=3e-3, **_MIXTURE),
        "tp-gmm": Space(
            GMRConfig, resolution=1e-3, **_MIXTURE, via_std_factor=_VIA_STD_FACTOR
        ),
        "local-gp": Space(
            LocalGPConfig,
            resolution=3e-4,
            clusters=Setting(8, 2, 16),
            width=_log(0.35, 0.15, 2.0),
        ),
        "wishart-gp": Space(
            WishartGPConfig,
            resolution=3e-3,
            degrees=Setting(7, 6, 20),
            length_scale=_log(0.15, 0.05, 1.0),
            floor=_log(1e-3, 1e-4, 0.1),
        ),
        "kmp": Space(
            KMPConfig,
            resolution=1e-3,
            components=Setting(8, 4, 15),
            length_scale=_log(0.144, 0.05, 0.6),
            mean_regularisation=_log(1.0, 0.05, 50.0),
            covariance_regularisation=_log(400.0, 20.0, 3000.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gmm-gp": Space(
            GMMGPConfig,
            resolution=3e-3,
            components=Setting(6, 3, 12),
            weight_power=Setting(1.0, 0.4, 1.0),
            shortest_length_scale=_log(0.005, 0.005, 1.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "prodmp": Space(
            ProDMPConfig,
            resolution=1e-3,
            n_basis=Setting(20, 8, 40),
            alpha=_log(25.0, 10.0, 60.0),
            overlap=Setting(0.22, 0.1, 0.9),
            shrinkage=_log(1e-3, 1e-6, 0.5),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "midigap": Space(
            MiDiGaPConfig,
            resolution=3e-4,
            mode_angle=Setting(0.7, 0.3, 1.5),
            length_scale=_log(1.0, 0.05, 10.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gp-paper": Space(
            KerstingNoise,
            "noise",
            n_iterations=Setting(10, 2, 30),
            shortest_scale=_log(0.15, 0.1, 0.6),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gp": Space(
            MapNoise,
            "noise",
            shortest_scale=_log(0.15, 0.1, 0.6),
            via_std_factor=_VIA_STD_FACTOR,
        ),
    }
)
"""The spaces of the methods of Table 1 and of the additional ones, by policy."""


def tuned_settings() -> Mapping[str, Values]:
    """Return the settings found by tuning, by the name of the tuned policy."""
    file = Path(__file__).with_name("tuned.json")
    policies = json.loads(file.read_text(encoding="utf-8"))["policies"]
    return {
        name: policies[name]["tuned"]["settings"] for name in SPACES if name in policies
    }


def tuned(name: str, values: Values, resolution: float = 1e-4) -> Policy:
    """Return a policy of `SPACES` with other settings; the resolution is in metres."""
    space, method = SPACES[name], AS_PUBLISHED[name].method
    assert method is not None, "spaces are those of methods"
    settings, changes = dict(values), dict[str, Any]()
    if "via_std_factor" in settings:
        factor = settings.pop("via_std_factor")
        position, rotation = method.config.via_std
        via_std = (factor * position, factor * rotation)
        changes["config"] = replace(method.config, via_std=via_std)
    if not isinstance(method.profile, StiffnessProfile):
        profile = partial(profile_of_spread, resolution=(resolution, 3e-2))
        changes["profile"] = profile
    fit = partial(method.fit, **{space.argument: space.config(**settings)})
    text = ", ".join(f"{setting} {value}" for setting, value in values.items())
    return Policy(
        summary=f"{name}, tuned: {text.replace('_', ' ')}",
        make=replace(method, fit=fit, **changes),
    )
