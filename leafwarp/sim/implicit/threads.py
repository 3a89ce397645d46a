"""One thread for the dense algebra inside the factor."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _controller() -> ThreadpoolController:
    return ThreadpoolController()


def one_thread() -> AbstractContextManager:
    """Let BLAS and LAPACK run on one thread meanwhile.

    The blocks of a band are too small for more to help; where other programs run, threads that wait for each other made
    a factor 40 times slower. And the results have the same bits whatever the number of cores.
    """
    return _controller().limit(limits=1, user_api="blas")
