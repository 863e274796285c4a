"""The synthetic human that demonstrates doors, and random smooth motion."""

from experiments.teacher.habits import MESSY, TIDY, Habits
from experiments.teacher.synthetic_human import (
    DEMONSTRATED_RADII,
    Teacher,
    TeacherConfig,
    standard_teacher,
)

__all__ = [
    "DEMONSTRATED_RADII",
    "MESSY",
    "TIDY",
    "Habits",
    "Teacher",
    "TeacherConfig",
    "standard_teacher",
]
