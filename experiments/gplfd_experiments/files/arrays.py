"""Type of arrays of numbers."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""An array of float64; its docstring states shape and unit."""
