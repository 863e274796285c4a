"""Colours that print, and that the colour-blind tell apart."""

import itertools

import numpy as np
import pytest

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.recording import colours

LINES = ("BEFORE", "ADAPTED", "TRUTH", "AXIS_X", "AXIS_Z", "LIMIT", "MARK")
# Viénot, Brettel and Mollon 1999, in linear RGB.
BLINDNESS = {
    "protanopia": [[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.0, 0.0, 1.0]],
    "deuteranopia": [[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [0.0, 0.0, 1.0]],
}
XYZ = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
WHITE = [0.9505, 1.0, 1.089]


def linear(colour):
    """Linear RGB of ``#rrggbb``."""
    srgb = np.array(list(bytes.fromhex(colour[1:]))) / 255.0
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def lab(rgb):
    """CIELAB of a linear RGB colour."""
    ratio = np.array(XYZ) @ rgb / WHITE
    root = np.where(ratio > 0.008856, np.cbrt(ratio), 7.787 * ratio + 16 / 116)
    x, y, z = root
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


def test_lines_stand_out_from_white_paper_in_the_hue_of_the_recordings():
    for name in LINES:
        printed = linear(getattr(style, name))
        assert 1.05 / (printed @ XYZ[1] + 0.05) >= 3.0, name
        if name in ("BEFORE", "AXIS_X", "AXIS_Z"):
            ratio = printed / linear("#" + bytes(getattr(colours, name)).hex())
            np.testing.assert_allclose(ratio, ratio[0], rtol=0.1)


@pytest.mark.parametrize("kind", BLINDNESS)
@pytest.mark.parametrize(
    "together", [("BEFORE", "ADAPTED", "TRUTH"), ("AXIS_X", "AXIS_Z", "LIMIT")]
)
def test_colours_that_meet_differ_for_the_colour_blind(together, kind):
    seen = [lab(BLINDNESS[kind] @ linear(getattr(style, name))) for name in together]
    for one, other in itertools.combinations(seen, 2):
        assert np.linalg.norm(one - other) > 15.0
