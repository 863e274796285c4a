"""Type of arrays of numbers, and derivatives of sampled ones."""

import math
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""An array of float64; its docstring states shape and unit."""


def smoothed(
    values: FloatArray,
    window: int,
    order: int,
    *,
    deriv: int = 0,
    step: float = 1.0,
    mode: Literal["interp", "nearest"] = "interp",
) -> FloatArray:
    """Return polynomials fitted in moving windows, or their derivative.

    After Savitzky and Golay along the first axis, as `scipy.signal.savgol_filter`,
    whose import takes a second: the ``window`` of samples is odd, ``step`` their
    distance. With the mode "interp", polynomials of the outer windows reach the ends.
    """
    half = window // 2
    powers = np.arange(-half, half + 1.0)[::-1] ** np.arange(order + 1)[:, None]
    wanted = np.zeros(order + 1)
    wanted[deriv] = math.factorial(deriv) / step**deriv
    weights, *_ = scipy.linalg.lstsq(powers, wanted)
    filtered: FloatArray = scipy.ndimage.convolve1d(
        values, weights, axis=0, mode="constant" if mode == "interp" else mode
    )
    if mode == "interp":
        places = np.arange(window)[:, None]
        for ends, rows in (
            (slice(window), slice(half)),
            (slice(-window, None), slice(-half, None)),
        ):
            gains = np.polyfit(places[:, 0], values[ends].reshape(window, -1), order)
            for _ in range(deriv):
                gains = gains[:-1] * np.arange(len(gains) - 1, 0, -1)[:, None]
            fitted = np.polyval(gains, places[rows]) / step**deriv
            filtered[rows] = fitted.reshape(filtered[rows].shape)
    return filtered
