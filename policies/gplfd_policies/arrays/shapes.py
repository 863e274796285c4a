"""Shapes of arrays for all signatures.

M is the number of phases and D the number of demonstrations; the six outputs are those
of a pose, (x, y, z, θu_x, θu_y, θu_z) [m, rad]. In a call, a letter is one number.

Shapes are annotations of jaxtyping, which the tests check at run time. If jaxtyping is
not installed, e.g. on a robot, an annotation is just the array type:
``Float[np.ndarray, "M 6"]`` is ``np.ndarray``.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from jaxtyping import Bool as Bool
    from jaxtyping import Complex as Complex
    from jaxtyping import Float as Float
    from jaxtyping import Int as Int
else:
    try:
        from jaxtyping import Bool, Complex, Float, Int
    except ModuleNotFoundError:

        class Float:
            """Replaces jaxtyping's type: an array of any shape and number type."""

            def __class_getitem__(cls, array_and_shape: tuple[Any, str]) -> Any:
                return array_and_shape[0]

        Bool = Complex = Int = Float

Times = Float[np.ndarray, " M"]  # Phases of the task, or other times.
Curve = Float[np.ndarray, " M"]  # One number at each of these times.
Curves = Float[np.ndarray, "D M"]  # One such curve per demonstration.
Gram = Float[np.ndarray, "M M"]  # Covariance of one output between these times.
Pose = Float[np.ndarray, "6"]  # The six outputs at one phase.
Outputs = Float[np.ndarray, "M 6"]
"""The six outputs, their standard deviations, or their rates at M phases."""
OutputCurves = Float[np.ndarray, "D M 6"]
"""The six outputs at M phases, per demonstration."""
Covariances = Float[np.ndarray, "6 M M"]  # Covariance over time of every output.
SixAxes = Float[np.ndarray, " 6"]
"""One number for each translation and each rotation of a hand."""
Axes = Float[np.ndarray, "*N 6"]
"""Such numbers of one hand, without a leading axis, or of N hands."""
Vectors = Float[np.ndarray, "*N 3"]
"""Positions, directions or forces of one hand or of N hands."""
Frames = Float[np.ndarray, "*N 3 3"]
"""Three directions, as columns, of one hand or of N hands."""
