"""Settings that ``benchmarks/tune.py`` searches, and the policies that it has found.

No method should win only by its settings. Each method has a space of the settings that
its authors would tune, with plausible limits. The best settings found are stored in
``tuned.json`` and registered as ``<name>-tuned``. The controller is the same for all
and not included, but for the resolution of its stiffness law, which is chosen after the
settings.
"""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from gplfd_policies.adaptation import ProcessAdaptation
from gplfd_policies.control.stiffness import StiffnessProfile
from gplfd_policies.gp.noise import KerstingNoise, MapNoise
from gplfd_policies.movements.baselines.dmp import DMPConfig
from gplfd_policies.movements.baselines.gmm_gp import GMMGPConfig
from gplfd_policies.movements.baselines.gmr import GMRConfig
from gplfd_policies.movements.baselines.kmp import KMPConfig
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig
from gplfd_policies.movements.baselines.midigap import MiDiGaPConfig
from gplfd_policies.movements.baselines.prodmp import ProDMPConfig
from gplfd_policies.movements.baselines.promp import ProMPConfig
from gplfd_policies.movements.baselines.wishart_gp import WishartGPConfig
from gplfd_policies.registry.built_in import AS_PUBLISHED
from gplfd_policies.registry.method import Policy, profile_of_spread

Value = bool | int | float
Values = Mapping[str, Value]


class Setting(NamedTuple):
    """One number or choice of a method; its type is that of its values."""

    published: Value
    """Value in the policy with the method's plain name."""
    low: Value
    """Least value."""
    high: Value
    """Greatest value."""
    logarithmic: bool = False
    """Whether the scale is logarithmic."""


class Space:
    """The settings of a method by name, which are arguments of ``config``.

    Two settings do not belong to the fit: ``via_std_factor`` multiplies the standard
    deviation of via-points, and ``empirical_share`` belongs to `ProcessAdaptation`.

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
            empirical_share=Setting(0.3, 0.0, 0.9),
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
    """Return a policy of `SPACES` with other settings.

    ``resolution`` is that of its stiffness law [m].
    """
    space, method = SPACES[name], AS_PUBLISHED[name].method
    assert method is not None, "spaces are those of methods"
    settings, changes = dict(values), dict[str, Any]()
    if "via_std_factor" in settings:
        factor = settings.pop("via_std_factor")
        position, rotation = method.config.via_std
        via_std = (factor * position, factor * rotation)
        changes["config"] = replace(method.config, via_std=via_std)
    if "empirical_share" in settings:
        share = settings.pop("empirical_share")
        changes["adaptation"] = partial(ProcessAdaptation, empirical_share=share)
    if not isinstance(method.profile, StiffnessProfile):
        profile = partial(profile_of_spread, resolution=(resolution, 3e-2))
        changes["profile"] = profile
    fit = partial(method.fit, **{space.argument: space.config(**settings)})
    text = ", ".join(f"{setting} {value}" for setting, value in values.items())
    return Policy(
        summary=f"{name}, tuned: {text.replace('_', ' ')}",
        make=replace(method, fit=fit, **changes),
    )
