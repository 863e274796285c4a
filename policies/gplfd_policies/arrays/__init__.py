"""Immutable records of arrays, rows of a batch, archives; one thread of BLAS.

Every module that computes imports something from here, in every process, which limits
the BLAS of NumPy and SciPy to one thread. The number of threads determines the order of
summation, and with it the last bits of a product. One thread is also faster: matrices
have about a hundred rows, and distributing them costs ten times the work itself.

The limit needs threadpoolctl. If that is not installed, e.g. on a robot, BLAS uses the
number of threads with which the process was started: set ``OPENBLAS_NUM_THREADS=1``.
"""

# SciPy has its own BLAS, which must be loaded before it can be limited.
import scipy.linalg  # noqa: F401

try:
    from threadpoolctl import threadpool_limits
except ModuleNotFoundError:
    pass
else:
    threadpool_limits(limits=1, user_api="blas")
