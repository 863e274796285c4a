"""Immutable records of arrays, rows of a batch, archives; one thread of BLAS.

Every module that computes imports something from here, in every process, which limits
the BLAS of NumPy and SciPy to one thread. The number of threads determines the order of
summation, and with it the last bits of a product. One thread is also faster: matrices
have about a hundred rows, and distributing them costs ten times the work itself.

Where threadpoolctl is not installed, e.g. on a robot, the OpenBLAS that the wheels of
NumPy and SciPy bring is limited. For another BLAS set its variable, such as
``MKL_NUM_THREADS=1``, before Python starts.
"""

import ctypes
from pathlib import Path

import numpy

# SciPy has its own BLAS, which must be loaded before it can be limited.
import scipy.linalg

try:
    from threadpoolctl import threadpool_limits
except ModuleNotFoundError:
    for package, integers in ((numpy, "64_"), (scipy, "")):
        place = Path(str(package.__file__)).parent
        for file in place.with_name(f"{place.name}.libs").glob("*openblas*"):
            library = ctypes.CDLL(str(file))
            getattr(library, f"scipy_openblas_set_num_threads{integers}")(1)
else:
    threadpool_limits(limits=1, user_api="blas")
