"""Array types, the checks every value type makes (right shape, read-only), and rows of dataclasses of arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Rows = TypeVar("Rows", bound="DataclassInstance")
"""A dataclass all of whose fields are arrays (n, …) of the same n."""


def frozen(values: ArrayLike, shape: tuple[int | None, ...], dtype: Any = np.float64) -> NDArray[Any]:
    """A read-only copy of ``values`` of the given dtype; ``None`` in ``shape`` matches any length.

    Raises ValueError where the shape does not match.
    """
    array = np.array(values, dtype=dtype, order="C")
    if array.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, array.shape, strict=True)):
        needed = tuple("n" if n is None else n for n in shape)
        raise ValueError(f"an array of shape {array.shape} was given where {needed} is needed")
    array.flags.writeable = False
    return array


def points(values: ArrayLike, dimensions: int = 2) -> Floats:
    """``values`` as an (N, dimensions) float64 array, not copied where it is one already.

    Raises ValueError for any other shape.
    """
    array: Floats = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != dimensions:
        raise ValueError(f"points of shape {array.shape} were given where (N, {dimensions}) is needed")
    return array


def selected(rows: Rows, keep: Bools | Ints) -> Rows:
    """``rows`` with the elements ``keep`` of each of its arrays, a mask (n,) or positions (m,)."""
    return replace(rows, **{field.name: getattr(rows, field.name)[keep] for field in fields(rows)})


def joined(parts: Sequence[Rows]) -> Rows:
    """All rows of ``parts``, one part or more, one after the other."""
    names = [field.name for field in fields(parts[0])]
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})
