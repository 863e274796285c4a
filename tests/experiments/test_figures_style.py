"""Colours that print, and that the colour-blind tell apart."""

import numpy as np
import pytest

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.recording import colours

LINES = {
    name: getattr(style, name)
    for name in ("BEFORE", "ADAPTED", "TRUTH", "AXIS_X", "AXIS_Z", "LIMIT", "MARK")
}


def linear(colour: str) -> np.ndarray:
    srgb = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0
    low = srgb / 12.92
    return np.where(srgb <= 0.04045, low, ((srgb + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize("name", LINES)
def test_lines_stand_out_from_white_paper(name: str) -> None:
    luminance = float(linear(LINES[name]) @ [0.2126, 0.7152, 0.0722])
    assert 1.05 / (luminance + 0.05) >= 3.0


def test_colours_keep_the_hue_of_the_recordings() -> None:
    for name in ("BEFORE", "AXIS_X", "AXIS_Z"):
        screen = linear("#" + "".join(f"{c:02x}" for c in getattr(colours, name)))
        ratio = linear(LINES[name]) / screen
        np.testing.assert_allclose(ratio, ratio[0], rtol=0.1)


# Viénot, Brettel and Mollon 1999, in linear RGB.
BLINDNESS = {
    "protanopia": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0]],
    "deuteranopia": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0]],
}
TOGETHER = [
    ("BEFORE", "ADAPTED"),
    ("BEFORE", "TRUTH"),
    ("ADAPTED", "TRUTH"),
    ("AXIS_X", "AXIS_Z"),
    ("AXIS_X", "LIMIT"),
    ("AXIS_Z", "LIMIT"),
]


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize("pair", TOGETHER, ids="-".join)
def test_colours_that_meet_differ_for_the_colour_blind(
    pair: tuple[str, str], kind: str
) -> None:
    seen = []
    for name in pair:
        colour = linear(LINES[name])
        red, green = np.array(BLINDNESS[kind]) @ colour
        seen.append(lab(np.array([red, green, colour[2]])))
    assert np.linalg.norm(seen[0] - seen[1]) > 15.0


def lab(rgb: np.ndarray) -> np.ndarray:
    """CIELAB of a linear RGB colour."""
    matrix = [
        [0.4124, 0.3576, 0.1805],
        [0.2126, 0.7152, 0.0722],
        [0.0193, 0.1192, 0.9505],
    ]
    ratio = np.array(matrix) @ rgb / np.array([0.9505, 1.0, 1.089])
    root = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    x, y, z = root
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])
