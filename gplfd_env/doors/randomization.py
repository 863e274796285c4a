"""Ranges from which every episode draws its door and circumstances.

All draws come from the environment's generator, one uniform number per parameter, also
for those that are not varied: randomisations that differ in one range draw the same
values for all others.
"""

import dataclasses
import hashlib
import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Literal

import numpy as np

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import EN_1154, en1154, leaf, spring_hinge
from gplfd_env.doors.parts import Closer, Lockset
from gplfd_env.doors.presets import preset_table
from gplfd_env.doors.variation import Perception, Placement, SensorNoise, Variation
from gplfd_env.validation.fields import (
    allowed_range,
    check_quantities,
    checked_number,
    choice,
    quantity,
)
from gplfd_env.validation.named import preset

Pair = tuple[float, float]

Doors = Literal["given", "standard"]
"""The door to which the ranges apply: the given one, or one drawn by the standards."""


# Key of a field's metadata: the ranges of both numbers of a pair.
_LIMITS: Final = "limits"


def _half_width(name: str) -> Any:
    """Declare the half-width of the range of a field of `Placement`."""
    allowed = allowed_range(Placement, name)
    return quantity(0.0, unit=allowed.unit, low=0.0, high=allowed.high)


def _pair(record: type, first: str, second: str = "") -> Any:
    """Declare a range that replaces a field, or None; or two standard deviations."""
    limits = allowed_range(record, first), allowed_range(record, second or first)
    default = (0.0, 0.0) if second else None
    return dataclasses.field(default=default, metadata={_LIMITS: limits})


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorRandomization:
    """Ranges from which every reset draws.

    A pair ``(low, high)`` is a uniform range that replaces the door's own value; None
    leaves it unchanged. Errors of base and grasp are drawn within plus or minus the
    given number. Raises a ValueError if a range is reversed or beyond what the door,
    the placement or the sensors allow, a TypeError if a field is not of numbers.
    """

    radius: Pair | None = _pair(DoorConfig, "radius")
    """Handle-to-hinge distance [m]."""
    hinge_friction: Pair | None = _pair(DoorConfig, "hinge_friction")
    """Coulomb friction of the hinge [N m]."""
    hinge_damping: Pair | None = _pair(DoorConfig, "hinge_damping")
    """Viscous friction of the hinge [N m s/rad]."""
    closer_stiffness: Pair | None = _pair(Closer, "stiffness")
    """Closing torque that grows with the angle [N m/rad]."""
    closer_preload: Pair | None = _pair(Closer, "preload")
    """Constant closing torque [N m]."""
    panel_mass: Pair | None = _pair(DoorConfig, "panel_mass")
    """Mass of the leaf [kg]."""
    handle_height: Pair | None = _pair(DoorConfig, "handle_height")
    """Height of the handle above the floor [m]."""
    base_position: float = _half_width("base_x")
    """Placement error of the base in x and y, each within ± this [m]."""
    base_yaw: float = _half_width("base_yaw")
    """Heading error of the base within ± this [rad]."""
    grasp_height: float = _half_width("grasp_height")
    """Error of the grasped point along the bar within ± this [m]."""
    grasp_depth: float = _half_width("grasp_depth")
    """Error of the bar's position between the finger pads within ± this [m]."""
    pose_noise: Pair = _pair(SensorNoise, "position", "rotation")
    """Standard deviations of the observed position [m] and rotation vector [rad]."""
    wrench_noise: Pair = _pair(SensorNoise, "force", "torque")
    """Standard deviations of the observed force [N] and torque [N m]."""
    perception: Pair = _pair(Perception, "position", "rotation")
    """Standard deviations of the error of the believed grasp: position [m] and rotation
    vector [rad], per axis, truncated at three. Only with ``start="approach"``."""
    shortest_delay: int = quantity(0, unit="control periods", low=0, high=10)
    """Commands take effect after this many control periods or more ..."""
    longest_delay: int = quantity(0, unit="control periods", low=0, high=10)
    """... at most after this many."""
    doors: Doors = choice("given", Doors)
    """``"given"``: the environment's door, changed by the ranges above; ``"standard"``:
    a door drawn by `standard_door` instead."""

    def __post_init__(self) -> None:
        check_quantities(self)
        for field in dataclasses.fields(self):
            values, limits = getattr(self, field.name), field.metadata.get(_LIMITS)
            if values is None or limits is None:
                continue
            label = f"DoorRandomization.{field.name}"
            if not isinstance(values, Collection) or len(values) != 2:
                raise ValueError(f"{label} = {values!r} must be a pair of numbers")
            low, high = map(checked_number, (label, label), values, limits)
            if field.default is None and low > high:
                raise ValueError(f"{label} = {values} must be (low, high), low <= high")
            object.__setattr__(self, field.name, (low, high))
        if self.shortest_delay > self.longest_delay:
            raise ValueError(
                f"DoorRandomization.shortest_delay = {self.shortest_delay} must not "
                f"exceed longest_delay = {self.longest_delay}"
            )

    @property
    def idle(self) -> bool:
        """Whether nothing is varied."""
        return self == DoorRandomization()

    def check_start(self, start: Start) -> None:
        """Raise a ValueError if the randomisation does not suit this start."""
        if start == "grasped" and any(self.perception):
            raise ValueError(
                "DoorRandomization.perception is the error of the believed handle when "
                'reaching for it: it needs start="approach" (--start approach)'
            )

    def outermost(self, door: DoorConfig) -> list[DoorConfig]:
        """Return the doors of each kind with the highest handle farthest out."""
        doors = [door]
        if self.doors == "standard":
            width, backset = max(LEAVES)
            far = leaf(width, backset=backset) | {"handle_height": _HEIGHTS[1]}
            kinds: Any = itertools.product(_HANDLES, _SWINGS, _SIDES)
            names = "handle", "swing", "hinge_side"
            doors = [
                DoorConfig(**far, **dict(zip(names, x, strict=True))) for x in kinds
            ]
        drawn = {"radius": self.radius, "handle_height": self.handle_height}
        ends = {name: pair[1] for name, pair in drawn.items() if pair is not None}
        return [other.replaced(ends) for other in doors]

    def sample(self, door: DoorConfig, rng: np.random.Generator) -> Variation:
        """Draw one episode; the number of draws depends only on `doors`."""
        varied = [x.name for x in dataclasses.fields(self) if x.default is None]
        ranges = {name: getattr(self, name) for name in varied}
        draws = iter(rng.random(len(ranges) + 6).tolist())
        if self.doors == "standard":
            door = standard_door(np.random.default_rng(int(rng.integers(2**63))))
        fields: dict[str, Any] = {"closer": {}}
        for name, bounds in ranges.items():
            share = next(draws)
            if bounds is not None:
                of_closer = name.startswith("closer_")
                part = fields["closer"] if of_closer else fields
                value = bounds[0] + share * (bounds[1] - bounds[0])
                part[name.removeprefix("closer_")] = value
        widths = {"base_x": self.base_position, "base_y": self.base_position}
        widths |= {"base_yaw": self.base_yaw}
        widths |= {"grasp_height": self.grasp_height, "grasp_depth": self.grasp_depth}
        errors = {x: (2.0 * next(draws) - 1.0) * width for x, width in widths.items()}
        names = "position", "rotation", "force", "torque"
        noise = dict(zip(names, (*self.pose_noise, *self.wrench_noise), strict=True))
        span = self.longest_delay - self.shortest_delay + 1
        delay = self.shortest_delay + int(next(draws) * span)
        return Variation(
            door=door.replaced(fields),
            placement=Placement(**errors),
            noise=SensorNoise(**noise),
            delay=min(delay, self.longest_delay),
        )


RandomizationSpec = str | Mapping[str, Any] | DoorRandomization
"""What `door_randomization` accepts."""


def door_randomization(spec: RandomizationSpec) -> DoorRandomization:
    """Return the randomisation of a preset's name, a mapping of fields, or a record.

    A mapping starts from its ``"preset"``. Raises a ValueError for an unknown preset or
    field, or an impossible range, a TypeError for anything else.
    """
    return preset(spec, RANDOMIZATIONS, "none", "randomization")


RANDOMIZATIONS: Final[Mapping[str, DoorRandomization]] = MappingProxyType(
    preset_table("randomizations", DoorRandomization())
)
"""Mild: residual errors of a careful laboratory. Hard: a new door in every episode.
Standard: a door of a building in every episode, without placement errors. Detector: the
error with which a good RGB-D detector finds a handle."""


LEAVES: Final = (
    *((width, 0.055) for width in (0.584, 0.709, 0.834, 0.959)),
    *((w, b) for w in (0.610, 0.711, 0.762, 0.813, 0.914) for b in (0.060, 0.070)),
)
"""Width of a leaf and its backset [m]: DIN 18101 and 18251, ANSI A250 and A156.2."""

_HANDLES: Final = {"lever": 0.4, "knob": 0.375, "bar": 0.225}
_SWINGS: Final = {"pull": 0.5, "push": 0.5}
_SIDES: Final = {"right": 0.5, "left": 0.5}
_HEIGHTS: Final = (0.865, 1.07)
_CONSTRUCTIONS: Final = ("honeycomb", "tubular-strips", "tubular-core", "chipboard")
_BEARINGS: Final = {"ball": 0.5, "plain": 0.4, "worn": 0.1}
_CLOSERS: Final = {"none": 0.6, "spring hinge": 0.1, "EN 1154": 0.3}
_LARGEST: Final = 2  # Greatest power size of a closer that is drawn.


def standard_door(rng: np.random.Generator) -> DoorConfig:
    """Draw a door of a building: its structure, leaf, handle, latch and closer."""
    width, backset = LEAVES[rng.integers(len(LEAVES))]
    construction = _CONSTRUCTIONS[rng.integers(len(_CONSTRUCTIONS))]
    bearing = _choice(_BEARINGS, rng)
    fields: dict[str, Any] = leaf(width, construction, backset=backset, bearing=bearing)
    handle = _choice(_HANDLES, rng)
    fields |= {
        "handle": handle,
        "latch": "none" if handle == "bar" else "spring",
        "swing": _choice(_SWINGS, rng),
        "hinge_side": _choice(_SIDES, rng),
        "handle_height": rng.uniform(*_HEIGHTS),
        "hinge_damping": rng.uniform(0.1, 1.0),
        "stiction": rng.uniform(0.0, 4.0),
        "seal": rng.uniform(0.0, 3.0),
        "seal_angle": math.radians(rng.uniform(2.0, 5.0)),
    }
    throw = (0.0127, 0.019)[rng.integers(2)]
    lockset = {"bolt_throw": throw, "bolt_preload": rng.uniform(2.5, 8.0)}
    if handle == "lever":
        lockset |= {
            "handle_length": rng.uniform(0.105, 0.125),
            "handle_preload": rng.uniform(0.35, 0.70),
            "handle_stiffness": rng.uniform(0.9, 1.4),
            "handle_travel": rng.uniform(0.65, 0.96),
        }
    else:
        lockset |= {
            "handle_preload": rng.uniform(0.10, 0.25),
            "handle_stiffness": rng.uniform(0.1, 0.3),
            "handle_travel": rng.uniform(math.radians(45.0), math.radians(60.0)),
        }
    fields["lockset"] = Lockset(**lockset)
    # There is no closer if the leaf needs a larger one than `_LARGEST`.
    closer = _choice(_CLOSERS, rng)
    narrow = [x for x, row in EN_1154.items() if x <= _LARGEST and width <= row.widest]
    sizes = [x for x in narrow if fields["panel_mass"] <= EN_1154[x].heaviest]
    if closer == "EN 1154" and sizes:
        least = EN_1154[sizes[0]].efficiency
        fields["closer"] = en1154(sizes[0], rng.uniform(least + 0.1, 0.9))
    elif closer == "spring hinge":
        fields["closer"] = spring_hinge(rng.uniform(3.0, 8.0))
    return DoorConfig(**fields)


def _choice(shares: dict[str, float], rng: np.random.Generator) -> str:
    names = list(shares)
    return names[int(rng.choice(len(names), p=list(shares.values())))]


def seed_of_door(seed: int, door: str) -> int:
    """Return a seed of random draws that each door of a seed has for itself."""
    digest = hashlib.sha256(f"{seed} {door}".encode()).digest()
    return int.from_bytes(digest[:4]) % 1_000_000_000
