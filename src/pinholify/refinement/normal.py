"""Normal equations of the joint solve with the poses eliminated: an arrow, and its Schur complement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.refinement.model import Linearisation
from pinholify.refinement.observations import Observations


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Least squares at unit noise over the globals θ, the poses at their optimum for each θ.

    ``matrix`` (D, D) S and ``right`` (D,) of S δθ = right; ``misfit`` the sum of squares that poses alone
    leave; ``log_det_poses`` Σ log|C_k|; ``inverse_roots`` (K, 6, 6) L⁻¹ of C_k = L Lᵀ; ``cross`` (K, 6, D)
    L⁻¹ E_k with E_k the block of pose and globals; ``pose_right`` (K, 6) L⁻¹ of the poses' right-hand sides;
    ``rows`` the number of residuals.
    """

    matrix: Floats
    right: Floats
    misfit: float
    log_det_poses: float
    inverse_roots: Floats
    cross: Floats
    pose_right: Floats
    rows: int

    def pose_steps(self, step: Floats) -> Floats:
        """The poses' best steps (K, 6) beside ``step`` (D,) of the globals."""
        remainder = self.pose_right - self.cross @ step
        return np.asarray(np.einsum("kji,kj->ki", self.inverse_roots, remainder))


def eliminate(
    linear: Linearisation, residual: Floats, weight: Floats, seen: Observations, damping: float = 0.0
) -> NormalEquations:
    """The equations for ``residual`` (N, 2) with ``weight`` (N,) of each corner's square.

    ``damping`` adds that part of its diagonal to each pose's block and to the shared parameters' (Levenberg-
    Marquardt).
    """
    root = np.sqrt(weight)
    basis = linear.basis * root[:, None]
    shared, pose, r = (a * root.reshape(-1, *[1] * (a.ndim - 1)) for a in (linear.shared, linear.pose, residual))
    matrix, right = _global_blocks(basis, shared, r, damping)
    blocks = seen.sums(np.einsum("nai,naj->nij", pose, pose))
    blocks *= 1.0 + damping * np.eye(6)
    inverse_roots = np.linalg.inv(np.linalg.cholesky(blocks))
    pose_right = np.einsum("kij,kj->ki", inverse_roots, seen.sums(np.einsum("nai,na->ni", pose, r)))
    cross = inverse_roots @ _cross_blocks(basis, shared, pose, seen)
    flat = cross.reshape(-1, cross.shape[2])
    log_det = -2.0 * float(np.log(np.diagonal(inverse_roots, axis1=1, axis2=2)).sum())
    return NormalEquations(
        matrix - flat.T @ flat,
        right - flat.T @ pose_right.ravel(),
        float((r**2).sum() - (pose_right**2).sum()),
        log_det,
        inverse_roots,
        cross,
        pose_right,
        r.size,
    )


def _global_blocks(basis: Floats, shared: Floats, r: Floats, damping: float) -> tuple[Floats, Floats]:
    m, p = basis.shape[1], shared.shape[2]
    matrix = np.empty((2 * m + p, 2 * m + p))
    gram = basis.T @ basis
    matrix[:m, :m] = matrix[m : 2 * m, m : 2 * m] = gram
    matrix[:m, m : 2 * m] = matrix[m : 2 * m, :m] = 0.0
    for axis in (0, 1):
        rows = slice(axis * m, (axis + 1) * m)
        matrix[rows, 2 * m :] = basis.T @ shared[:, axis]
        matrix[2 * m :, rows] = matrix[rows, 2 * m :].T
    flat = shared.reshape(-1, p)
    block = flat.T @ flat
    matrix[2 * m :, 2 * m :] = block + damping * np.diag(np.diag(block))
    return matrix, np.concatenate([(basis.T @ r).T.ravel(), flat.T @ r.ravel()])


def _cross_blocks(basis: Floats, shared: Floats, pose: Floats, seen: Observations) -> Floats:
    """(K, 6, D)."""
    m, p = basis.shape[1], shared.shape[2]
    cross = np.empty((seen.boards, 6, 2 * m + p))
    for k, rows in enumerate(seen.slices()):
        jacobian = pose[rows].reshape(-1, 6)
        if m:
            cross[k, :, :m] = pose[rows, 0].T @ basis[rows]
            cross[k, :, m : 2 * m] = pose[rows, 1].T @ basis[rows]
        cross[k, :, 2 * m :] = jacobian.T @ shared[rows].reshape(-1, p)
    return cross
