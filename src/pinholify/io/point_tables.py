"""Point tables: the CSV files, of up to millions of points, that ``pinholify map`` reads and writes."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from pinholify.arrays import Floats
from pinholify.errors import InputError
from pinholify.io.files import TextFile, reading_text, source_name, writing_text

_CHUNK = 10_000

_PIXEL, _PLANE, _RAY = ["u", "v"], ["x", "y"], ["x", "y", "z"]
"""Column names of points; the columns may be in any position."""


def read_points(
    source: TextFile, *, dimensions: int | None = None, on_unused: Callable[[list[str]], object] | None = None
) -> Floats:
    """Read points of ``dimensions`` numbers from the table ``source``, a path or an open text stream.

    The first line is a header; every other line is one point, so rows keep their number and order. The columns are
    those named u, v or x, y for two dimensions and x, y, z for three, in any position, otherwise the first ones.
    Without ``dimensions`` there are three if x, y, z are named or the third column is z, otherwise two, never u, v.
    ``on_unused`` is called with the names of the other columns, if any. Returns (N, 2) or (N, 3) float64; nan stands
    for a point that does not exist. Raises InputError, with the line number.
    """
    name = source_name(source)
    with reading_text(source) as stream:
        lines = stream.readlines()
    while lines and not lines[-1].strip():
        del lines[-1]
    names = [field.strip(' "\n') for field in lines[0].split(",")] if lines else []
    count = dimensions or _dimensions(names)
    _check_header(name, lines, count)
    named = {2: (_PIXEL, _PLANE), 3: (_RAY,), None: (_RAY, _PLANE)}[dimensions]
    columns = _chosen(names, count, [wanted for wanted in named if len(wanted) == count])
    unused = [field for index, field in enumerate(names) if index not in columns]
    if unused and on_unused is not None:
        on_unused(unused)
    return _points(name, lines[1:], columns)


def write_points(target: TextFile, header: Sequence[str], columns: ArrayLike) -> None:
    """Write the table of ``columns`` (N, len(header)) to ``target``, a path or an open text stream.

    Numbers keep 15 significant digits; missing values are nan. Raises ValueError if the header does not match, and
    OutputError if the file cannot be written.
    """
    rows = np.asarray(columns, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != len(header):
        raise ValueError(f"columns of shape {rows.shape} were given where (N, {len(header)}) is needed")
    line = ",".join(["%.15g"] * len(header)) + "\n"
    with writing_text(target) as stream:
        stream.write(",".join(header) + "\n")
        for start in range(0, len(rows), _CHUNK):
            chunk = rows[start : start + _CHUNK]
            stream.write(line * len(chunk) % tuple(chunk.ravel().tolist()))


def _dimensions(names: list[str]) -> int:
    return 3 if names[2:3] == ["z"] or {"x", "y", "z"} <= set(names) else 2


def _chosen(names: list[str], count: int, named: list[list[str]]) -> list[int]:
    """Indices of the columns of points: the first of the ``named`` sets that is present, or the first ``count``."""
    for wanted in named:
        if all(names.count(name) == 1 for name in wanted):
            return [names.index(name) for name in wanted]
    return list(range(count))


def _check_header(name: str, lines: list[str], columns: int) -> None:
    example = "u,v" if columns == 2 else "x,y,z"
    if not lines:
        raise InputError(f"'{name}' is empty; a header line such as {example} is needed, then one line per point")
    fields = lines[0].rstrip("\n").split(",")
    if all(_is_number(field) for field in fields):
        raise InputError(f"'{name}', line 1: numbers where a header such as {example} is needed; add one")
    if len(fields) < columns:
        raise InputError(
            f"'{name}', line 1: the header has {len(fields)} of the {columns} columns that are needed, "
            f"separated by commas, for example {example}"
        )


def _points(name: str, lines: list[str], columns: list[int]) -> Floats:
    """Read with NumPy's own reader; only if it fails, look for the line at fault."""
    if not lines:
        return np.empty((0, len(columns)))
    try:
        points = np.loadtxt(lines, delimiter=",", usecols=columns, comments=None, ndmin=2)
    except ValueError:
        points = np.empty((0, len(columns)))
    if len(points) != len(lines) or np.isinf(points).any():
        raise _blame(name, lines, columns)
    return points


def _blame(name: str, lines: list[str], columns: list[int]) -> InputError:
    """The error that names the first of ``lines`` (without the header) that is not a point."""
    for number, line in enumerate(lines, start=2):
        problem = _problem(line, columns)
        if problem:
            return InputError(f"'{name}', line {number}: {problem}")
    return InputError(f"'{name}' is not a table of numbers separated by commas; write it as plain CSV")


def _problem(line: str, columns: list[int]) -> str:
    fields = line.split(",") if line.strip() else []
    needed = max(columns) + 1
    if len(fields) < needed:
        return f"{len(fields)} numbers were found where {needed} are needed, separated by commas"
    wrong = next((fields[i].strip() for i in columns if not _is_number(fields[i])), None)
    return "" if wrong is None else f"'{wrong[:40]}' was found where a finite number or nan is needed"


def _is_number(field: str) -> bool:
    try:
        return not math.isinf(float(field)) and "_" not in field
    except ValueError:
        return False
