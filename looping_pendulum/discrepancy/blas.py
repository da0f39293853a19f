"""Linear algebra in one thread."""

from __future__ import annotations

from threadpoolctl import threadpool_limits


def one_blas_thread() -> threadpool_limits:
    """Let NumPy and SciPy do linear algebra in one thread, from now on or inside this context.

    With matrices this small a second thread only takes processor time, and sums by two threads differ in their last digits.
    """
    return threadpool_limits(1, user_api="blas")
