"""What a person says about a file that the file does not say itself."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.raw import METRES, RADIANS, SECONDS

_LISTED: Final = 30  # Names at most in a message.

QuaternionOrder = Literal["wxyz", "xyzw"]
"""Where the scalar part stands: first or last."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Selection:
    """What to read of a file, and how to understand it.

    Raises:
        ValueError: A unit or an order is unknown, or a rate no positive number.
    """

    body: str | None = None
    """What moves: a segment, joint, marker, topic or array of the file."""
    columns: tuple[str, ...] = ()
    """Names of the columns of a table, in order, see `readers.tables`."""
    units: str | None = None
    """Unit of the positions, one of `METRES`; before what the file says."""
    time_unit: str | None = None
    """Unit of time stamps in tables and arrays, one of `SECONDS`; before what the file
    says, and seconds where neither says one."""
    angles: str = "rad"
    """Unit of rotation vectors without one, one of `RADIANS`."""
    quaternions: QuaternionOrder | None = None
    """Order of quaternions whose components have no names."""
    recorded_rate: float | None = None
    """Samples per second of a file without time stamps [Hz]."""
    urdf: Path | None = None
    """Description of the robot whose joints were recorded."""
    link: str | None = None
    """Link of that robot which is the hand."""

    def __post_init__(self) -> None:
        for option, value, known in (
            ("--units", self.units, METRES),
            ("--time-unit", self.time_unit, SECONDS),
            ("--angles", self.angles, RADIANS),
            ("--quaternions", self.quaternions, ("wxyz", "xyzw")),
        ):
            if value is not None and value not in known:
                raise ValueError(
                    f"{option} {value!r} must be one of {', '.join(known)}"
                )
        rate = self.recorded_rate
        if rate is not None and not 0.0 < rate < math.inf:
            raise ValueError(f"--recorded-rate {rate} must be a positive number [Hz]")


def chosen(
    wanted: str | None, known: dict[str, Any], what: str, *, file: str
) -> tuple[str, Any]:
    """Return the named one of several things in a file, or the only one.

    Args:
        wanted: `Selection.body`.
        known: What the file has, by name.
        what: What these are called in a message.
        file: Name of the file, for a message.

    Raises:
        ValueError: There is none, none of that name, or several to choose from.
    """
    if not known:
        raise ValueError(f"{file} has no {what}")
    names = ", ".join(sorted(known)[:_LISTED]) + (", …" if len(known) > _LISTED else "")
    if wanted is None:
        if len(known) > 1:
            raise ValueError(
                f"{file} has more than one {what}; choose with --body: {names}"
            )
        (wanted,) = known
    if wanted not in known:
        hint = nearest_name(wanted, known)
        raise ValueError(f"{file} has no {what} {wanted!r}{hint}; it has {names}")
    return wanted, known[wanted]
