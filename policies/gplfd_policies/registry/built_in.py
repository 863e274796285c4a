"""Learners, changes of their pipeline, policies, and spaces for tuning, by name.

Every policy that learns a movement is a learner in a pipeline. The default pipeline is
the same for all. ``name@published`` is a method as its authors published it,
``name@no-size`` a learner in a pipeline without a part.

The learners that are compared have spaces of settings, with plausible limits in
``spaces.toml``: their authors' and, alike for all, those of the shared pipeline.
``benchmarks/tune.py`` searches them; the best settings found are in ``tuned.json``, and
``name@tuned`` is the learner in the shared pipeline with them.
"""

import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from gplfd_env.validation.named import nearest_name
from gplfd_policies.adaptation.process import (
    ConditionedProcess,
    ExactAdaptation,
    ForceAdaptation,
    ProcessAdaptation,
)
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.agents.model_based.following import (
    ChordAgent,
    CompliantPullAgent,
    HingeFitAgent,
    ReflexAgent,
)
from gplfd_policies.agents.model_based.mechanism import MechanismFitAgent
from gplfd_policies.agents.model_based.oracle import OracleAgent, ToldHandleAgent
from gplfd_policies.arrays.shapes import Times
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
from gplfd_policies.gp.heteroscedastic import MapNoise
from gplfd_policies.movements.baselines.dmp import DMPConfig, fit_dmp
from gplfd_policies.movements.baselines.gmm_gp import GMMGPConfig, fit_gmm_gp
from gplfd_policies.movements.baselines.gmr import GMRConfig, fit_gmr
from gplfd_policies.movements.baselines.kmp import KMPConfig, fit_kmp
from gplfd_policies.movements.baselines.local_gp import fit_local_gp
from gplfd_policies.movements.baselines.prodmp import ProDMPConfig, fit_prodmp
from gplfd_policies.movements.baselines.promp import ProMPConfig, fit_promp
from gplfd_policies.movements.baselines.tp_gmm import fit_tp_gmm
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import EmpiricalDistribution
from gplfd_policies.movements.skill import Skill, fit_skill
from gplfd_policies.phase.phase_rule import POSE_ERROR, PathPhase, PathPhaseConfig
from gplfd_policies.registry.method import (
    Learner,
    Method,
    Pipeline,
    Policy,
    TrainingInput,
    demonstrated_phase,
    profile_of_spread,
)
from gplfd_policies.registry.summaries import SUMMARIES


def _sample_mean(aligned: AlignedDemonstrations) -> EmpiricalDistribution:
    return EmpiricalDistribution(aligned=aligned)


DOOR_KMP: Final = KMPConfig(mean_regularisation=1.0, covariance_regularisation=400.0)
"""λ as published, and λ_c = N, with which the prior variance is that of the
demonstrations; the published values are for letters in centimetres."""


def _conditioned(skill: Skill, grid: Times) -> ConditionedProcess:
    """Adapt by how repetitions deviate, which a single demonstration does not show."""
    form = ProcessAdaptation if skill.count > 1 else ExactAdaptation
    return form(skill, grid)


GP: Final = Learner(
    fit=fit_skill,
    accepts_prior_mean=True,
    adaptation=_conditioned,
    force_adaptation=ForceAdaptation,
)
"""The learner of this project."""

_LEARNERS: Final = {
    "gp": GP,
    "gp-homoscedastic": replace(GP, fit=partial(fit_skill, noise="homoscedastic")),
    "gp-paper": Learner(
        fit=partial(fit_skill, noise="kersting"),
        accepts_prior_mean=True,
        adaptation=partial(ProductAdaptation, prior_mean="zero"),
    ),
    "mean": Learner(fit=_sample_mean),
    "dmp": Learner(fit=partial(fit_dmp, config=DMPConfig(spread=True))),
    "promp": Learner(fit=fit_promp),
    "gmr": Learner(fit=fit_gmr),
    "tp-gmm": Learner(fit=fit_tp_gmm),
    "local-gp": Learner(fit=fit_local_gp, accepts_prior_mean=True),
    "wishart-gp": Learner(
        fit=partial(fit_wishart_gp, config=WishartGPConfig()),
        seeded=True,
        accepts_prior_mean=True,
    ),
    "kmp": Learner(fit=partial(fit_kmp, config=DOOR_KMP)),
    "gmm-gp": Learner(fit=fit_gmm_gp),
    "prodmp": Learner(fit=fit_prodmp),
}
LEARNERS: Final[Mapping[str, Learner]] = MappingProxyType(
    {
        name: replace(learner, summary=SUMMARIES["learners"][name])
        for name, learner in _LEARNERS.items()
    }
)
"""The learners by name; by this name alone, each is in the default `Pipeline`."""

TABLE_1: Final = (
    *("dmp", "promp", "gmr", "local-gp", "wishart-gp", "kmp", "gmm-gp"),
    *("gp-paper", "gp"),
)
"""The methods of the paper's Table 1, the paper's own among them, and ours."""

ONE_SIZE: Final = PathPhaseConfig(
    similarity=SimilarityConfig(size_std=0.0, size_weight=1e9)
)
"""Assumes that every door has the demonstrations' mean size."""

UNDAMPED: Final = replace(DEFAULT_DYNAMICS, least_damping=np.zeros(6))
"""Only critical damping: stable in free motion, but not in contact with a delay."""


def _positions_alone(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    """Align demonstrations without their rotations."""
    still = [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    return align(
        [replace(motion, poses=motion.poses * still) for motion in demonstrations]
    )


def _motion_only(demonstrations: Sequence[Demonstration]) -> AlignedDemonstrations:
    """Align demonstrations and leave out their forces."""
    return replace(align(demonstrations), wrenches=None)


def _constant(translation: float) -> StiffnessProfile:
    """Return a constant stiffness [N/m], in rotation a tenth of it [N m/rad]."""
    constant = np.repeat([translation, 0.1 * translation], 3)
    return replace(DEFAULT_PROFILE, k_min=constant, k_max=constant)


class Part(NamedTuple):
    """A change of the pipeline, by the fields that it replaces."""

    pipeline: Mapping[str, Any] = {}
    config: Mapping[str, Any] = {}
    """Fields of `Pipeline.config`."""


PARTS: Final[Mapping[str, Part]] = MappingProxyType(
    {
        "no-continuation": Part({"beyond": 0.0}),
        "no-modes": Part({"modes": None}),
        "no-size": Part({"size_inference": None}),
        "no-adaptation": Part({"adapts": False}),
        "one-size": Part({"phases": partial(PathPhase, config=ONE_SIZE)}),
        "no-rotation": Part({"align": _positions_alone}),
        "no-forces": Part({"align": _motion_only}),
        "carried-load": Part(config={"load": CarriedLoad()}),
        "undamped": Part(config={"dynamics": UNDAMPED}),
        "impedance": Part(
            config={
                "rendering": ArmRendering,
                "dynamics": ARM_DYNAMICS,
                "stiffness_frame": "axes",
            },
        ),
        "stiffness-from-force": Part({"phase_stiffness": stiffness_from_force}),
        "constant-100": Part({"profile": _constant(100.0)}),
        "constant-500": Part({"profile": _constant(500.0)}),
    }
)
"""Changes of the default pipeline by name, each of one part."""


def _published(resolution: float | None = None, **fields: Any) -> Pipeline:
    """Return the pipeline in which a method of others was published: few parts.

    The resolutions of the stiffness law [m] were chosen by one criterion and budget,
    see "The resolution of the stiffness law" in docs/notes/methods.md.
    """
    if resolution is not None:
        fields["profile"] = partial(profile_of_spread, resolution=(resolution, 3e-2))
    return Pipeline(beyond=0.0, modes=None, size_inference=None, **fields)


PUBLISHED: Final[Mapping[str, Method]] = MappingProxyType(
    {name: Method(learner=LEARNERS[name]) for name in ("gp", "gp-homoscedastic")}
    | {
        name: Method(learner=LEARNERS[name], pipeline=_published(resolution))
        for name, resolution in {
            "mean": None,
            "kmp": 1e-3,
            "promp": 3e-4,
            "gmr": None,
            "tp-gmm": 3e-3,
            "local-gp": 3e-3,
            "wishart-gp": 3e-3,
            "gmm-gp": 3e-3,
            "prodmp": None,
        }.items()
    }
    | {
        "dmp": Method(
            learner=replace(LEARNERS["dmp"], fit=fit_dmp),
            # Without uncertainty: the phase needs that of the demonstrations.
            pipeline=_published(phases=demonstrated_phase),
        ),
        "gp-paper": Method(
            learner=LEARNERS["gp-paper"],
            pipeline=_published(
                # DTW on the raw completion index of the whole recording.
                align=partial(align, method="dtw", denoise=False, trim_rests=False),
                # Ours where the paper gives no details: the phase of an observation
                # (by the clock no door opens), its via-point noise, and the governor.
                profile=PAPER_PROFILE,
                config=ComplianceConfig(
                    load=YieldToAll(),
                    dynamics=PAPER_DYNAMICS,
                    stiffness_frame="axes",
                    max_turn_lead=1.0,
                ),
            ),
        ),
    }
)
"""Each learner as its authors published it, `gp` as this project does."""


def _untaught(agent: Callable[[], object], training: TrainingInput) -> object:
    return agent()


_REFERENCES: Final[Mapping[str, Callable[[], object]]] = {
    "hinge-fit": HingeFitAgent,
    "hinge-fit-told": ToldHandleAgent,
    "mechanism-fit": MechanismFitAgent,
    "reflex": ReflexAgent,
    "chord": ChordAgent,
    "compliant-pull": CompliantPullAgent,
    "oracle": OracleAgent,
}
POLICIES: Final[Mapping[str, Policy]] = MappingProxyType(
    {
        name: Policy(summary=learner.summary, make=Method(learner=learner))
        for name, learner in LEARNERS.items()
    }
    | {
        name: Policy(
            summary=SUMMARIES["references"][name],
            make=partial(_untaught, agent),
            kind="reference",
            told=name in ("hinge-fit-told", "oracle"),
        )
        for name, agent in _REFERENCES.items()
    }
)
"""Built-in policies: every learner in the default pipeline, and model-based ones."""


def in_pipeline(name: str, policy: Policy, pipeline: str) -> Policy:
    """Return a policy whose learner is in another pipeline.

    Args:
        name: Name of the policy.
        policy: The policy in the default pipeline.
        pipeline: "published", "tuned", or names of `PARTS` joined by "+".

    Raises:
        ValueError: The policy has no learner, or not this pipeline.
    """
    method = policy.method
    if method is None:
        raise ValueError(f"{name}@{pipeline}: {name} has no learner and no pipeline")
    if pipeline == "published" and name in PUBLISHED:
        return replace(
            policy, summary=f"{policy.summary}; as published", make=PUBLISHED[name]
        )
    if pipeline == "tuned" and name in SPACES:
        return tuned(name, tuned_settings()[name])
    changed, summary = method.pipeline, [policy.summary]
    replaced: dict[str, str] = {}
    for part in pipeline.split("+"):
        if part not in PARTS:
            ways = ["published"] * (name in PUBLISHED) + ["tuned"] * (name in SPACES)
            raise ValueError(
                f"{name}@{pipeline}: unknown pipeline {part!r}"
                f"{nearest_name(part, [*ways, *PARTS])}; there are "
                f"{', '.join([*ways, *PARTS])}; parts may be joined by +"
            )
        for field in (*PARTS[part].pipeline, *PARTS[part].config):
            if replaced.setdefault(field, part) != part:
                raise ValueError(f"{name}@{pipeline}: two of its parts replace {field}")
        config = replace(changed.config, **PARTS[part].config)
        changed = replace(changed, config=config, **PARTS[part].pipeline)
        summary.append(SUMMARIES["parts"][part])
    return replace(
        policy,
        summary="; ".join(summary),
        make=replace(method, pipeline=changed),
        kind="ablation",
    )


Value = int | float
Values = Mapping[str, Value]


class Setting(NamedTuple):
    """One number: published value, least and greatest, and its scale."""

    published: Value
    low: Value
    high: Value
    logarithmic: bool = False


class Space(NamedTuple):
    """The settings of a learner and its pipeline."""

    settings: Mapping[str, Setting]
    """By name: those of the pipeline, and arguments of `config`."""
    config: Callable[..., object] | None = None
    """Makes the configuration of the fit from the others; None if it has none."""
    argument: str = "config"
    """Name of the fit's argument for this configuration."""

    @property
    def published(self) -> Values:
        """The settings of the learner in the default pipeline."""
        return {name: setting.published for name, setting in self.settings.items()}


_SPACES: Final = {
    name: {setting: Setting(**limits) for setting, limits in settings.items()}
    for name, settings in tomllib.loads(
        Path(__file__).with_name("spaces.toml").read_text("utf-8")
    ).items()
}
_FITS: Final[Mapping[str, tuple[Any, ...]]] = {
    "mean": (),
    "dmp": (partial(DMPConfig, spread=True),),
    "promp": (ProMPConfig,),
    "prodmp": (ProDMPConfig,),
    "gmr": (GMRConfig,),
    "kmp": (KMPConfig,),
    "gmm-gp": (GMMGPConfig,),
    "gp": (MapNoise, "noise"),
}
"""What makes the configuration of a learner's fit, and the name of its argument."""
SPACES: Final[Mapping[str, Space]] = MappingProxyType(
    {
        name: Space(_SPACES["pipeline"] | _SPACES.get(name, {}), *fit)
        for name, fit in _FITS.items()
    }
)
"""The spaces of the learners that are compared, by name."""


def tuned_settings() -> Mapping[str, Values]:
    """Return the settings found by tuning, by learner."""
    file = Path(__file__).with_name("tuned.json")
    policies = json.loads(file.read_text(encoding="utf-8"))["policies"]
    return {name: policies[name]["tuned"]["settings"] for name in SPACES}


def tuned(name: str, values: Values) -> Policy:
    """Return a learner in the shared pipeline with other settings of both.

    ``resolution`` is that of the stiffness law [m]; ``size_std`` that of the prior of a
    door's size; and ``via_std_factor`` multiplies the noise of via-points.
    """
    space, learner = SPACES[name], LEARNERS[name]
    settings = {**space.published, **values}
    resolution, size_std, factor = map(settings.pop, _SPACES["pipeline"])
    position, rotation = POSE_ERROR
    sizes = PathPhaseConfig(similarity=SimilarityConfig(size_std=size_std))
    pipeline = Pipeline(
        profile=partial(profile_of_spread, resolution=(resolution, 3e-2)),
        phases=partial(PathPhase, config=sizes),
        config=ComplianceConfig(via_std=(factor * position, factor * rotation)),
    )
    if space.config is not None:
        fit = partial(learner.fit, **{space.argument: space.config(**settings)})
        learner = replace(learner, fit=fit)
    text = ", ".join(f"{setting} {value:.3g}" for setting, value in values.items())
    return Policy(
        summary=f"{name}, tuned: {text.replace('_', ' ')}",
        make=Method(learner=learner, pipeline=pipeline),
    )
