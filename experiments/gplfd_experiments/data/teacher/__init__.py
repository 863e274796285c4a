"""The synthetic human that demonstrates doors, and random smooth motion."""

from gplfd_experiments.data.teacher.forces import ForceConfig
from gplfd_experiments.data.teacher.motion import (
    DEMONSTRATED_RADII,
    MESSY,
    ROOM_RADII,
    TIDY,
    Habits,
    doors_like,
)
from gplfd_experiments.data.teacher.synthetic_human import (
    Teacher,
    TeacherConfig,
    standard_teacher,
)

__all__ = [
    "DEMONSTRATED_RADII",
    "MESSY",
    "ROOM_RADII",
    "TIDY",
    "ForceConfig",
    "Habits",
    "Teacher",
    "TeacherConfig",
    "doors_like",
    "standard_teacher",
]
