"""Colours and their meanings, equal in the scene and in every panel."""

from typing import Final

Colour = tuple[int, int, int]

DEMONSTRATION: Final[Colour] = (205, 210, 222)
BEFORE: Final[Colour] = (122, 140, 178)  # The policy before it measured the door.
ADAPTED: Final[Colour] = (214, 120, 255)  # The policy after adaptation to the motion.
TRUTH: Final[Colour] = (80, 220, 140)  # The handle's true motion.
HAND: Final[Colour] = (250, 220, 90)  # The hand's motion; via-points are its samples.
LEAF: Final[Colour] = (200, 165, 120)
FORCE: Final[Colour] = (255, 92, 92)
OUTSIDE: Final[Colour] = (245, 245, 245)  # Events from outside.
AXIS_X: Final[Colour] = (255, 159, 67)  # Along the path or pull.
AXIS_Z: Final[Colour] = (84, 190, 255)  # Across the path, to or from the hinge.
AXES: Final = (AXIS_X, AXIS_Z)
LIMIT: Final[Colour] = (255, 92, 92)
MARK: Final[Colour] = (128, 134, 148)
BACKGROUND: Final[Colour] = (24, 27, 33)
