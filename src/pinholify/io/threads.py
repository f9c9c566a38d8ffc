"""How many threads linear algebra takes."""

from __future__ import annotations

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_blas_thread() -> None:
    """Let linear algebra run in one thread, unless the environment says otherwise; to be called before NumPy loads.

    The matrices here are small: more threads cost more than they bring, and where several processes each start as many
    as there are processors, they wait for one another most of the time.
    """
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")
