"""The vectorised, safeguarded Newton solver for all inverses of the simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from pinholify.arrays import Bools, Floats, Ints

Equations = Callable[[Floats, Ints], tuple[Floats, Floats]]
"""``(unknowns (n, d), rows (n,)) → (values (n, d), Jacobians (n, d, d))``; rows are the numbers of the systems."""


def solve(
    equations: Equations, target: Floats, start: Floats, *, tolerance: float = 1e-12, steps: int = 80
) -> Floats:
    """Unknowns (N, d), d = 1 or 2, at which N small systems reach ``target`` (N, d); NaN where none are found.

    Newton's method from ``start`` (N, d), with a separate step length for each system that is halved while the residual
    does not decrease. A root is accepted if its residual is at most ``tolerance``·(1 + ‖target‖); iterations continue
    below that until rounding stops them.
    """
    x = np.array(start, dtype=np.float64)
    scale = 1 + np.linalg.norm(target, axis=1)
    residual = np.full(len(x), np.inf)
    rows = np.flatnonzero(np.isfinite(target).all(axis=1) & np.isfinite(x).all(axis=1))
    step, residual[rows] = _newton_step(equations, target, x[rows], rows)
    length = np.ones(len(rows))
    for _ in range(steps):
        if not len(rows):
            break
        trial = x[rows] - length[:, None] * step
        new_step, new_residual = _newton_step(equations, target, trial, rows)
        better = new_residual < residual[rows]
        x[rows[better]], residual[rows[better]] = trial[better], new_residual[better]
        step[better] = new_step[better]
        length = np.where(better, np.minimum(2 * length, 1), length / 2)
        keep = _unfinished(length, residual[rows] / scale[rows], tolerance)
        rows, step, length = rows[keep], step[keep], length[keep]
    x[~(residual <= tolerance * scale)] = np.nan
    return x


def _unfinished(length: Floats, relative_residual: Floats, tolerance: float) -> Bools:
    at_rounding = (relative_residual <= 2e-16) | (length < 1) & (relative_residual <= tolerance)
    hopeless = length < 1e-6
    return np.asarray(~(at_rounding | hopeless))


def _newton_step(equations: Equations, target: Floats, x: Floats, rows: Ints) -> tuple[Floats, Floats]:
    with np.errstate(all="ignore"):
        value, jacobian = equations(x, rows)
        excess = value - target[rows]
        step = excess / jacobian[:, 0] if x.shape[1] == 1 else _solve_2x2(jacobian, excess)
        residual = np.linalg.norm(excess, axis=1)
        # A system without a finite step cannot continue from here; the caller retries nearer to the previous point.
        return step, np.where(np.isfinite(step).all(axis=1), residual, np.inf)


def _solve_2x2(matrix: Floats, right: Floats) -> Floats:
    (a, b), (c, d) = matrix[:, 0].T, matrix[:, 1].T
    p, q = right.T
    return np.asarray(np.stack([d * p - b * q, a * q - c * p], axis=1) / (a * d - b * c)[:, None])


def smallest_positive(roots: Iterable[complex], default: float) -> float:
    """The smallest of the real positive ``roots``, or ``default`` if there are none."""
    return min((z.real for z in roots if abs(z.imag) < 1e-12 and z.real > 0), default=default)
