"""Attributes of geoms and sites that touch nothing or are not drawn."""

from typing import Any, Final

INTANGIBLE: Final[dict[str, Any]] = {"contype": 0, "conaffinity": 0}
"""Of a geom that touches nothing."""

UNDRAWN: Final[dict[str, Any]] = {"size": [0.005] * 3, "rgba": [0, 0, 0, 0]}
"""Of a site that only marks a frame."""
