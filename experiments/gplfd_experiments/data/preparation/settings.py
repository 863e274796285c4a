"""Settings of the preparation of motions."""

from dataclasses import dataclass
from typing import Final, Literal, get_args

from gplfd_experiments.data.raw import WRIST, Transform, WrenchSensor, unit_transform

FrameName = Literal["first-pose", "recorded", "hinge"]
Segments = Literal["none", "rests", "turns"] | tuple[tuple[float, float], ...]

_LARGEST: Final = 1e5  # Of a rate or a cut-off [Hz], and of a gap [s].


@dataclass(frozen=True, kw_only=True, slots=True)
class Preparation:
    """Settings of `prepare`; the defaults suit a hand recorded at 50 Hz or more.

    Raises:
        ValueError: A value is outside its range, or a transform is not a pose.
    """

    units: str | None = None
    """Unit of the recorded positions; None for what the file says, else metres."""
    offset: Transform | None = None
    """Pose of the moved object in the recorded frame, such as from a glove's tracker
    to the handle in the hand."""
    sensor: WrenchSensor = WRIST
    """How forces were recorded, where the file does not say."""
    frame: FrameName | Transform = "first-pose"
    """Frame of the result: each motion's first pose, the recorded frame, that of a
    door whose hinge is found from the motion, or a pose in the recorded frame."""
    segments: Segments = "none"
    """Repetitions in a motion: the whole, or what lies between rests or turns without
    motions back, or start and end of each since the first sample [s]."""
    trim_rests: bool = True
    """Whether rests at both ends are cut to those of a gentle motion."""
    cutoff: float | None = 10.0
    """Cut-off of the low-pass filter [Hz], forwards and backwards, so without delay;
    None for none. People move their hands at less than 5 Hz."""
    rate: float | None = 100.0
    """Samples per second of the result [Hz]; None for the samples as recorded."""
    largest_gap: float = 0.5
    """Longest time without a sample that is bridged by a straight line [s]."""

    def __post_init__(self) -> None:
        for name in ("cutoff", "rate", "largest_gap"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value <= _LARGEST:
                raise ValueError(
                    f"{name} = {value:g} must be a positive number to {_LARGEST:g}"
                )
        for name in ("offset", "frame"):
            pose = getattr(self, name)
            if pose is not None and not isinstance(pose, str):
                object.__setattr__(self, name, unit_transform(name, pose))
        frames = get_args(FrameName)
        if isinstance(self.frame, str) and self.frame not in frames:
            raise ValueError(
                f"frame {self.frame!r} must be one of {', '.join(frames)}, or a pose "
                "x,y,z,qw,qx,qy,qz"
            )
        if isinstance(self.segments, str):
            if self.segments not in ("none", "rests", "turns"):
                raise ValueError(
                    f"segments {self.segments!r} must be none, rests, turns, or times "
                    "such as 1.5-4.2,6-9.5 [s]"
                )
            return
        for start, end in self.segments:
            if not start < end:
                raise ValueError(f"a segment from {start} to {end} s ends too early")
