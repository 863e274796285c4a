"""Immutable records of arrays, rows of a batch, archives; one thread of BLAS.

Every module that computes imports something from here, in every process.
"""

from gplfd_policies.arrays.threads import use_one_blas_thread

use_one_blas_thread()
