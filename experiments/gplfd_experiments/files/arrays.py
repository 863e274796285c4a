"""What all rooms call the arrays that they pass on."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Numbers; their shape and unit are said where they are used."""
