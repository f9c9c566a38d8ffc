"""Array types and the two checks every value type makes: right shape, and read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def frozen(values: ArrayLike, shape: tuple[int | None, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of ``values`` with the given dtype; ``None`` in ``shape`` matches any length.

    Raises ValueError with the shape found and the shape needed.
    """
    array = np.array(values, dtype=dtype, order="C")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        needed = tuple("n" if n is None else n for n in shape)
        raise ValueError(f"an array of shape {array.shape} was given where {needed} is needed")
    array.flags.writeable = False
    return array


def points(values: ArrayLike, dimensions: int = 2) -> Floats:
    """``values`` as an (N, dimensions) float64 array, without a copy where it is one already.

    Raises ValueError with the shape found and the shape needed.
    """
    array: Floats = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != dimensions:
        raise ValueError(f"points of shape {array.shape} were given where (N, {dimensions}) is needed")
    return array
