"""Normal equations of the joint solve with the poses eliminated: a matrix of arrow shape, and its Schur complement.

Every board's pose enters only that board's residuals, so the poses are eliminated one by one, and what is left is a
system of the globals θ alone, however many boards there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.refinement.model import Linearisation
from pinholify.refinement.observations import Observations


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Least squares at unit noise over the globals θ, with the poses at their optimum for each θ.

    The system is S δθ = s with ``matrix`` S (D, D) and ``right`` s (D,). ``misfit`` is the sum of squares after a step
    of the poses alone, ``rows`` the number of residuals. For the block C_k = L Lᵀ of each board's pose and the block
    E_k of pose and globals, ``log_det_poses`` is Σ log|C_k|, ``inverse_roots`` (K, 6, 6) are L⁻¹, ``cross`` (K, 6, D)
    L⁻¹ E_k, and ``pose_right`` (K, 6) L⁻¹ times the poses' right-hand sides. Where boards move, 6 becomes 9: the
    motion, with its prior, is a part of the pose, and ``log_det_poses`` includes that prior's determinant.
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
        """The best steps (K, 6) of the poses together with ``step`` (D,) of the globals."""
        remainder = self.pose_right - self.cross @ step
        return np.asarray(np.einsum("kji,kj->ki", self.inverse_roots, remainder))


def eliminate(
    linear: Linearisation, residual: Floats, weight: Floats, seen: Observations, damping: float = 0.0
) -> NormalEquations:
    """The equations for ``residual`` (N, 2), with the ``weight`` (N,) of each corner's squared residual.

    ``damping`` (Levenberg-Marquardt) adds that share of its diagonal to the block of each pose and to that of β and η.
    Raises numpy.linalg.LinAlgError where a pose has no effect.
    """
    root = np.sqrt(weight)[:, None]
    basis = linear.basis if (weight == 1.0).all() else linear.basis * root
    dense = np.concatenate([linear.pose, linear.shared, residual[:, :, None]], axis=2)
    dense *= root[:, :, None]
    own, stiff = linear.pose.shape[2], linear.stiffness
    gram = linear.functions.gram(linear.undisplaced, weight)
    matrix, right = _global_blocks(gram, basis, dense[:, :, own:], damping)
    products = _board_products(basis, dense, seen, own)
    products[:, :, -own - 1] -= stiff * linear.moved
    products[:, :, -own:] += np.diag(stiff)
    inverse_roots = np.linalg.inv(np.linalg.cholesky(products[:, :, -own:] * (1.0 + damping * np.eye(own))))
    reduced = inverse_roots @ products[:, :, :-own]
    cross, pose_right = reduced[:, :, :-1], reduced[:, :, -1]
    flat = cross.reshape(-1, cross.shape[2])
    diagonals = np.diagonal(inverse_roots, axis1=1, axis2=2)
    if not (diagonals > 0.0).all():
        raise np.linalg.LinAlgError("the equations of a pose are singular in double precision")
    log_det = -2.0 * float(np.log(diagonals).sum())
    log_det -= seen.boards * float(np.log(stiff[stiff > 0.0]).sum())
    r = dense[:, :, -1]
    return NormalEquations(
        matrix - flat.T @ flat,
        right - flat.T @ pose_right.ravel(),
        float((r**2).sum() + (stiff * linear.moved**2).sum() - (pose_right**2).sum()),
        log_det,
        inverse_roots,
        cross,
        pose_right,
        r.size,
    )


def _global_blocks(gram: Floats, basis: Floats, dense: Floats, damping: float) -> tuple[Floats, Floats]:
    """The globals' matrix (D, D) and right-hand side (D,), before the poses are eliminated.

    ``gram`` (M, M) is that of ``basis`` (N, M); ``dense`` (N, 2, P + 1) holds the shared derivatives and the residual.
    """
    m, p = basis.shape[1], dense.shape[2] - 1
    matrix, right = np.zeros((2 * m + p, 2 * m + p)), np.empty(2 * m + p)
    matrix[:m, :m] = matrix[m : 2 * m, m : 2 * m] = gram
    for axis in (0, 1):
        rows = slice(axis * m, (axis + 1) * m)
        products = basis.T @ dense[:, axis]
        matrix[rows, 2 * m :], matrix[2 * m :, rows], right[rows] = products[:, :p], products[:, :p].T, products[:, p]
    flat = dense.reshape(-1, p + 1)
    products = flat[:, :p].T @ flat
    matrix[2 * m :, 2 * m :], right[2 * m :] = products[:, :p], products[:, p]
    matrix[2 * m :, 2 * m :] += damping * np.diag(np.diag(products))
    return matrix, right


def _board_products(basis: Floats, dense: Floats, seen: Observations, pose: int) -> Floats:
    """Products (K, pose, D + 1 + pose) of the derivatives by the ``pose`` unknowns of each board with all others.

    The others are the derivatives by the globals, the residual, and the derivatives by the pose itself.
    """
    m, others = basis.shape[1], dense.shape[2] - pose
    products = np.empty((seen.boards, pose, 2 * m + others + pose))
    for k, rows in enumerate(seen.slices()):
        flat = dense[rows].reshape(-1, dense.shape[2])
        own = flat[:, :pose].T @ flat
        products[k, :, 2 * m : 2 * m + others], products[k, :, 2 * m + others :] = own[:, pose:], own[:, :pose]
        if m:
            products[k, :, :m] = dense[rows, 0, :pose].T @ basis[rows]
            products[k, :, m : 2 * m] = dense[rows, 1, :pose].T @ basis[rows]
    return products
