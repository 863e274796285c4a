"""Number of threads of linear algebra."""


def use_one_blas_thread() -> None:
    """Limit the BLAS of NumPy and SciPy to one thread, for this process.

    The number of threads determines the order of summation, and with it the last bits
    of a product. One thread is also faster: the policies' matrices have about a hundred
    rows, and distributing them among threads costs ten times the work itself.

    The limit needs threadpoolctl. If that is not installed, e.g. on a robot, BLAS uses
    the number of threads with which the process was started: set
    ``OPENBLAS_NUM_THREADS=1``.
    """
    # SciPy has its own BLAS, which must be loaded before it can be limited.
    import scipy.linalg  # noqa: F401

    try:
        from threadpoolctl import threadpool_limits
    except ModuleNotFoundError:
        return
    threadpool_limits(limits=1, user_api="blas")
