"""Covariance functions by the name a user gives. A new kernel is one file and one line here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pinholify.errors import InputError
from pinholify.gp.kernels.base import Kernel
from pinholify.gp.kernels.matern import Matern32, Matern52
from pinholify.gp.kernels.rational_quadratic import RationalQuadratic
from pinholify.gp.kernels.squared_exponential import SquaredExponential

KERNELS: dict[str, Callable[[], Kernel]] = {
    "se": SquaredExponential,
    "ard-se": lambda: SquaredExponential(length_scale=np.ones(2)),
    "matern32": Matern32,
    "matern52": Matern52,
    "rq": RationalQuadratic,
}
"""Factories of kernels of unit standard deviation and length scale, for two-dimensional inputs."""


def kernel_named(name: str) -> Kernel:
    """The kernel of unit scale called ``name``; raises InputError, listing the known names, for any other."""
    if name not in KERNELS:
        raise InputError(f"unknown kernel '{name}': choose one of {', '.join(KERNELS)}")
    return KERNELS[name]()


__all__ = ["KERNELS", "Kernel", "Matern32", "Matern52", "RationalQuadratic", "SquaredExponential", "kernel_named"]
