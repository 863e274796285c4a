"""The settings of each method that ``benchmarks/tune.py`` searches, and their limits.

No method should win only by its settings. Each method has a space of the settings that
its authors would tune, with plausible limits. The best settings found are stored in
``tuned.json`` and registered as ``<name>-tuned``. The controller is the same for all
and not included, but for the resolution of its stiffness law, which is chosen after the
settings.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gplfd_policies.adaptation import ProcessAdaptation
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
from gplfd_policies.registry.method import Method

TUNED_FILE: Final = Path(__file__).with_name("tuned.json")
"""Results of tuning, with their origin."""

Value = bool | int | float
Values = Mapping[str, Value]


@dataclass(frozen=True, kw_only=True, slots=True)
class Setting:
    """One number or choice of a method; its type is that of its values."""

    published: Value
    """Value in the policy with the method's plain name."""
    low: Value
    """Least value."""
    high: Value
    """Greatest value."""
    logarithmic: bool = False
    """Whether the scale is logarithmic."""

    def at(self, share: float) -> Value:
        """Return the value at a share of the way from low to high, to three digits."""
        if isinstance(self.published, bool | int):
            count = int(self.high) - int(self.low) + 1
            whole = int(self.low) + min(int(share * count), count - 1)
            return type(self.published)(whole)
        if self.logarithmic:
            return float(f"{self.low * (self.high / self.low) ** share:.3g}")
        return float(f"{self.low + share * (self.high - self.low):.3g}")

    def __contains__(self, value: object) -> bool:
        return type(value) is type(self.published) and self.low <= value <= self.high


def _log(published: float, low: float, high: float) -> Setting:
    return Setting(published=published, low=low, high=high, logarithmic=True)


def _linear(published: Value, low: Value, high: Value) -> Setting:
    return Setting(published=published, low=low, high=high)


@dataclass(frozen=True, kw_only=True, slots=True)
class Space:
    """The settings of a method.

    Two settings do not belong to the fit: ``via_std_factor`` multiplies the standard
    deviation of via-points, and ``empirical_share`` belongs to `ProcessAdaptation`.
    """

    settings: Mapping[str, Setting]
    """Settings by name."""
    config: Callable[..., object]
    """Function that makes the configuration of the fit from the settings."""
    argument: str = "config"
    """Name of the fit's argument for this configuration."""
    resolution: float = 1e-4
    """Resolution of the stiffness law with the tuned settings [m]."""

    @property
    def published(self) -> Values:
        """The settings with which the method is registered."""
        return {name: one.published for name, one in self.settings.items()}

    def at(self, point: Sequence[float]) -> Values:
        """Return the settings at a point of the unit cube."""
        pairs = zip(self.settings.items(), point, strict=True)
        return {name: setting.at(share) for (name, setting), share in pairs}

    def method(self, registered: Method, values: Values) -> Method:
        """Return a method with other settings."""
        if values.keys() != self.settings.keys():
            raise ValueError(
                f"the settings are {', '.join(self.settings)}, got {', '.join(values)}"
            )
        for name, setting in self.settings.items():
            if values[name] not in setting:
                raise ValueError(
                    f"{name} = {values[name]!r} must be "
                    f"{type(setting.published).__name__} from {setting.low} to "
                    f"{setting.high}"
                )
        own = dict(values)
        method = registered
        if "via_std_factor" in own:
            factor = own.pop("via_std_factor")
            position, rotation = method.config.via_std
            via_std = (factor * position, factor * rotation)
            method = replace(method, config=replace(method.config, via_std=via_std))
        if "empirical_share" in own:
            share = own.pop("empirical_share")
            adaptation = partial(ProcessAdaptation, empirical_share=share)
            method = replace(method, adaptation=adaptation)
        fit = partial(method.fit, **{self.argument: self.config(**own)})
        return replace(method, fit=fit)


def _space(
    config: Callable[..., object],
    argument: str = "config",
    *,
    resolution: float = 1e-4,
    **settings: Setting,
) -> Space:
    return Space(
        config=config, argument=argument, settings=settings, resolution=resolution
    )


_VIA_STD_FACTOR: Final = _log(1.0, 0.2, 10.0)
"""Factor on the via-point noise of 1 mm, 0.03 rad, for every method with via-points."""

_COMPONENTS: Final = _linear(10, 3, 20)
_REGULARISATION: Final = _log(4e-6, 1e-7, 1e-2)

SPACES: Final[Mapping[str, Space]] = MappingProxyType(
    {
        "dmp": _space(
            DMPConfig,
            resolution=3e-4,
            n_basis=_linear(30, 10, 60),
            alpha=_log(25.0, 10.0, 60.0),
            spread=_linear(False, False, True),
        ),
        "promp": _space(
            ProMPConfig,
            n_basis=_linear(20, 8, 40),
            overlap=_linear(0.7, 0.3, 0.95),
            shrinkage=_log(1e-6, 1e-8, 0.5),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gmr": _space(
            GMRConfig,
            resolution=3e-3,
            components=_COMPONENTS,
            regularisation=_REGULARISATION,
        ),
        "tp-gmm": _space(
            GMRConfig,
            resolution=1e-3,
            components=_COMPONENTS,
            regularisation=_REGULARISATION,
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "local-gp": _space(
            LocalGPConfig,
            resolution=3e-4,
            clusters=_linear(8, 2, 16),
            width=_log(0.35, 0.15, 2.0),
        ),
        "wishart-gp": _space(
            WishartGPConfig,
            resolution=3e-3,
            degrees=_linear(7, 6, 20),
            length_scale=_log(0.15, 0.05, 1.0),
            floor=_log(1e-3, 1e-4, 0.1),
        ),
        "kmp": _space(
            KMPConfig,
            resolution=1e-3,
            components=_linear(8, 4, 15),
            length_scale=_log(0.144, 0.05, 0.6),
            mean_regularisation=_log(1.0, 0.05, 50.0),
            covariance_regularisation=_log(400.0, 20.0, 3000.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gmm-gp": _space(
            GMMGPConfig,
            resolution=3e-3,
            components=_linear(6, 3, 12),
            weight_power=_linear(1.0, 0.4, 1.0),
            shortest_length_scale=_log(0.005, 0.005, 1.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "prodmp": _space(
            ProDMPConfig,
            resolution=1e-3,
            n_basis=_linear(20, 8, 40),
            alpha=_log(25.0, 10.0, 60.0),
            overlap=_linear(0.22, 0.1, 0.9),
            shrinkage=_log(1e-3, 1e-6, 0.5),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "midigap": _space(
            MiDiGaPConfig,
            resolution=3e-4,
            mode_angle=_linear(0.7, 0.3, 1.5),
            length_scale=_log(1.0, 0.05, 10.0),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gp-paper": _space(
            KerstingNoise,
            "noise",
            n_iterations=_linear(10, 2, 30),
            shortest_scale=_log(0.15, 0.1, 0.6),
            via_std_factor=_VIA_STD_FACTOR,
        ),
        "gp": _space(
            MapNoise,
            "noise",
            shortest_scale=_log(0.15, 0.1, 0.6),
            empirical_share=_linear(0.3, 0.0, 0.9),
            via_std_factor=_VIA_STD_FACTOR,
        ),
    }
)
"""The spaces of the methods of Table 1 and of the additional ones, by policy."""


def tuned_settings(file: Path = TUNED_FILE) -> Mapping[str, Values]:
    """Return the settings found by tuning, by the name of the tuned policy."""
    found = json.loads(file.read_text(encoding="utf-8"))["policies"]
    return {name: found[name]["tuned"]["settings"] for name in SPACES if name in found}
