"""The number of threads of linear algebra."""

from __future__ import annotations

import os

VARIABLES = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_blas_thread() -> None:
    """Run linear algebra in one thread, unless the environment says otherwise; call it before NumPy is imported.

    The matrices here are small: more threads cost more than they gain, and several processes that each start one thread
    per processor spend most of their time waiting for one another.
    """
    for variable in VARIABLES:
        os.environ.setdefault(variable, "1")
