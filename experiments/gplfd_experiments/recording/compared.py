"""What policies side by side can be compared by: a number over time each."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray


class Measured(NamedTuple):
    """A number over time that tells policies apart.

    Attributes:
        panel: Name of the panel's entity.
        title: Of the panel.
        values: From a log, (T,).
        greatest: What its greatest value is called, and its unit.
        meaning: A sentence or two for who sees it the first time.
    """

    panel: str
    title: str
    values: Callable[[EpisodeLog], FloatArray]
    greatest: tuple[str, str]
    meaning: str


def _beside_path(log: EpisodeLog) -> FloatArray:
    """How far the hand is from the policy's path, or from its command [mm]."""
    path = np.where(np.isfinite(log.desired), log.desired, log.action)
    beside: FloatArray = np.linalg.norm((log.ee_pose - path)[:, :3], axis=1)
    return 1e3 * beside


def _at_handle(log: EpisodeLog) -> FloatArray:
    forces = (log.force_tangential, log.force_radial, log.force_vertical)
    size: FloatArray = np.linalg.norm(forces, axis=0)
    return size


RADIAL: Final = "force_radial_peak"
"""What policies are compared by if nothing else is said."""

MEASURED: Final[Mapping[str, Measured]] = MappingProxyType(
    {
        RADIAL: Measured(
            "radial",
            "Radial force [N]: fights the hinge",
            lambda log: np.abs(log.force_radial),
            ("radial peak", "N"),
            "**Radial force** does no work: it tells that the path does not fit the "
            "door.",
        ),
        "force_handle_peak": Measured(
            "handle",
            "Force at the handle [N]",
            _at_handle,
            ("peak at the handle", "N"),
            "**Force at the handle** is what the hand must hold.",
        ),
        "person_force_peak": Measured(
            "person",
            "Force on the person [N]",
            lambda log: log.person_force,
            ("on the person", "N"),
            "**Force on the person:** ISO/TS 15066 allows a hand 140 N, and 280 N for "
            "an instant.",
        ),
        "stop_force_sustained": Measured(
            "stop",
            "Force on the stop [N]",
            lambda log: log.stop_force,
            ("on the stop", "N"),
            "**Force on the stop** is that of the door, as if at the handle.",
        ),
        "grasp_kept": Measured(
            "slip",
            "Slip of the hand on the handle [mm]",
            lambda log: 1e3 * log.slip,
            ("slip", "mm"),
            "**Slip** is how far the hand is from where it took hold.",
        ),
        "push_displacement_mm": Measured(
            "beside",
            "Hand beside its path [mm]",
            _beside_path,
            ("beside its path", "mm"),
            "**Beside its path** is how far the hand is from where the policy wants "
            "it, or from the command if it has no path.",
        ),
    }
)
"""By the name of the metric that an episode's number becomes."""
