"""The simplified Zhang's method: K = (f, uc, vc) from homographies in closed form.

B = K⁻ᵀK⁻¹ ∝ [[1, 0, −uc], [0, 1, −vc], [−uc, −vc, uc² + vc² + f²]] has four unknowns up to scale. (The paper prints B
with zeros below the diagonal and another last entry; B is symmetric.) Each homography H = (h₁ h₂ h₃) from a board to
the virtual plane gives h₁ᵀB h₂ = 0 and h₁ᵀB h₁ = h₂ᵀB h₂.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Bools, Floats, frozen
from pinholify.charts import Intrinsics
from pinholify.errors import DegenerateError
from pinholify.geometry import Pose, nearest_rotation

RANK_TOLERANCE = 1e-7  # per board, of equations whose coefficients are of order one: a smaller σ₃ is rounding error
NOISE_RATIO = 4.0  # σ₃ must stand out from σ₄, which is zero for exact data
TILT_MORE = (
    "add photographs in which the board is tilted in at least two ways, parallel neither to the reference nor to each "
    "other"
)


@dataclass(frozen=True, slots=True, eq=False)
class ClosedForm:
    """K in closed form, and the singular values (4,) of its equations, largest first; the last one is due to noise."""

    intrinsics: Intrinsics
    singular_values: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "singular_values", frozen(self.singular_values, (4,)))


def simplified_zhang(homographies: Floats, plane: Floats) -> ClosedForm:
    """K from ``homographies`` (n, 3, 3), board → virtual plane, in squares.

    ``plane`` (3, 3) is an isotropic similarity that normalises the plane: no other map preserves the form of B. The
    reference board's own homography, the identity, may be among them and adds nothing. Raises DegenerateError, with the
    singular values that prove it, unless two boards are parallel neither to the reference nor to each other.
    """
    values, singular, valid = solve(homographies[None], plane)
    closed = ClosedForm(Intrinsics(*(float(x) for x in values[0])), singular[0])
    third, fourth = singular[0, 2:]
    floor = max(RANK_TOLERANCE * np.sqrt(len(homographies)), NOISE_RATIO * fourth)
    if len(homographies) < 2 or third < floor or not valid[0]:
        raise DegenerateError(
            f"the {len(homographies)} boards do not determine f, uc and vc (singular values "
            f"{listed(singular[0])}: the third must stand out from the fourth): {TILT_MORE}"
        )
    return closed


def listed(singular_values: Floats) -> str:
    """Singular values as text for a person."""
    return ", ".join(f"{s:.2g}" for s in singular_values)


def solve(homographies: Floats, plane: Floats) -> tuple[Floats, Floats, Bools]:
    """Batched closed form: (f, uc, vc) (b, 3), singular values (b, 4) and whether f² > 0 (b,).

    ``homographies`` (b, n, 3, 3) are b sets of n boards.
    """
    h = plane @ homographies
    h = h / np.linalg.norm(h, axis=(-2, -1), keepdims=True)
    h1, h2 = h[..., 0], h[..., 1]
    rows = np.concatenate([_row(h1, h2), _row(h1, h1) - _row(h2, h2)], axis=-2)
    _, singular, vt = np.linalg.svd(rows, full_matrices=rows.shape[-2] < 4)
    singular = np.concatenate([singular, np.zeros((*singular.shape[:-1], 4 - singular.shape[-1]))], axis=-1)
    b11, b13, b23, b33 = np.moveaxis(vt[..., 3, :], -1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = -b13 / b11, -b23 / b11
        f_squared = b33 / b11 - u**2 - v**2
        valid = f_squared > 0
        f = np.sqrt(np.where(valid, f_squared, np.nan))
    scale, offset = plane[0, 0], plane[:2, 2]
    return np.stack([f, u - offset[0], v - offset[1]], axis=-1) / scale, singular, valid


def _row(p: Floats, q: Floats) -> Floats:
    """Coefficients (…, n, 4) of pᵀB q in b = (B11, B13, B23, B33), with B22 = B11 and B12 = 0."""
    return np.stack(
        [
            p[..., 0] * q[..., 0] + p[..., 1] * q[..., 1],
            p[..., 0] * q[..., 2] + p[..., 2] * q[..., 0],
            p[..., 1] * q[..., 2] + p[..., 2] * q[..., 1],
            p[..., 2] * q[..., 2],
        ],
        axis=-1,
    )


def pose_from_homography(homography: Floats, intrinsics: Intrinsics) -> Pose:
    """The pose camera_from_board that K and a ``homography`` (3, 3), board → virtual plane, imply; t_z > 0, squares."""
    m = np.linalg.solve(intrinsics.matrix, homography)
    m = m * 2.0 / (np.linalg.norm(m[:, 0]) + np.linalg.norm(m[:, 1]))
    m = m if m[2, 2] > 0 else -m
    rotation = nearest_rotation(np.column_stack([m[:, 0], m[:, 1], np.cross(m[:, 0], m[:, 1])]))
    return Pose(rotation, np.asarray(m[:, 2], dtype=np.float64))
