"""Small simulated calibrations with known truth; the lenses are written out here, apart from any of the package's."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats
from pinholify.board import Checkerboard, lattice
from pinholify.corners import Corners, CornerSet

SIZE = (800, 600)
FOCAL = 420.0
BOARD = Checkerboard(9, 6)

Project = Callable[[Floats], Floats]


def pinhole(xyz: Floats) -> Floats:
    return FOCAL * xyz[:, :2] / xyz[:, 2:] + [401.0, 297.0]


def fisheye(xyz: Floats) -> Floats:
    """Equidistant with a cubic term: 0.75 FOCAL px a radian, rays beyond 90° in the image's corners."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1]) + 1e-12
    theta = np.arctan2(rho, xyz[:, 2])
    radius = 0.75 * FOCAL * theta * (1.0 + 0.03 * theta**2)
    return xyz[:, :2] * (radius / rho)[:, None] + [396.0, 303.0]


def wavy(xyz: Floats) -> Floats:
    """A pinhole behind a pane that shifts points by up to a px, as no formula of a lens does."""
    uv = pinhole(xyz)
    return uv + np.column_stack([np.sin(uv[:, 0] / 61.0 + 0.3) * np.cos(uv[:, 1] / 83.0), np.sin(uv[:, 1] / 71.0)])


def decentred(xyz: Floats) -> Floats:
    """Brown's lens with two radial terms, decentred."""
    x, y = xyz[:, :2].T / xyz[:, 2]
    r2 = x**2 + y**2
    gain, p1, p2 = 1.0 - 0.2 * r2 + 0.05 * r2**2, 0.004, -0.003
    bent = [x * gain + 2 * p1 * x * y + p2 * (r2 + 2 * x**2), y * gain + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y]
    return FOCAL * np.column_stack(bent) + [401.0, 297.0]


def equisolid(xyz: Floats) -> Floats:
    """The common fisheye: r = 2 sin(θ/2), 0.7 FOCAL px a radian. The tangent law comes near to it and is not it."""
    rho = np.hypot(xyz[:, 0], xyz[:, 1]) + 1e-12
    radius = 1.4 * FOCAL * np.sin(np.arctan2(rho, xyz[:, 2]) / 2.0)
    return xyz[:, :2] * (radius / rho)[:, None] + [396.0, 303.0]


LENSES: dict[str, Project] = {"pinhole": pinhole, "fisheye": fisheye, "wavy": wavy}
PROJECTS = {**LENSES, "decentred": decentred, "equisolid": equisolid}


@dataclass(frozen=True)
class Scene:
    """Corners of ``views`` boards under ``project``, true poses of the boards, and the noise in px."""

    project: Project
    corners: CornerSet
    rotations: Floats
    translations: Floats
    noise: float


def make_scene(
    name: str,
    *,
    views: int = 14,
    noise: float = 0.1,
    seed: int = 0,
    bow: float = 0.0,
    stretch: float = 0.0,
    shear: float = 0.0,
    tilt: float = 35.0,
    warp: Floats | None = None,
    motion: float = 0.0,
    board: Checkerboard = BOARD,
) -> Scene:
    """``warp`` (corners, 3) shifts the board's corners; by ``motion`` (radians, std an axis) each board turns about the
    camera while as many rows are read as the image is high.
    """
    rng = np.random.default_rng(seed)
    project = PROJECTS[name]
    points = np.column_stack([lattice(board), np.zeros(board.columns * board.rows)])
    middle = points.mean(axis=0)
    xi = (points - middle)[:, :2] / middle[:2]
    shaped = points + np.column_stack(
        [shear * (points - middle)[:, 1], stretch * (points - middle)[:, 1], bow * (1 - (xi**2).mean(axis=1))]
    )
    shaped = shaped if warp is None else shaped + warp
    moves = np.random.default_rng(seed + 1000)
    rotations, translations, corners = [], [], []
    while len(corners) < views:
        first = not corners
        angles = rng.normal(0, 3, 3) if first else np.append(rng.normal(0, 10), rng.uniform(-tilt, tilt, 2))
        rotation = Rotation.from_euler("zyx", angles, degrees=True).as_matrix()
        depth = 6.0 if first else rng.uniform(5.0, 11.0)
        aim = np.zeros(2) if first else rng.uniform(-1.0, 1.0, 2) * (1.6 if name in ("fisheye", "equisolid") else 0.7)
        translation = depth * np.append(aim, 1.0) - rotation @ middle
        uv = project(shaped @ rotation.T + translation)
        uv = rolled(project, shaped @ rotation.T + translation, moves.normal(0, motion, 3)) if motion else uv
        if not ((uv > 3).all() and (uv < np.array(SIZE) - 4).all()):
            continue
        corners.append(Corners(f"view{len(corners):02d}", np.arange(len(uv)), uv + rng.normal(0, noise, uv.shape)))
        rotations.append(rotation)
        translations.append(translation)
    return Scene(project, CornerSet(board, SIZE, tuple(corners)), np.array(rotations), np.array(translations), noise)


def rolled(project: Project, points: Floats, turn: Floats) -> Floats:
    """Where ``points`` (n, 3) are seen that turn by ``turn`` while all rows are read, as each row meets its own."""
    uv = project(points)
    for _ in range(5):
        late = (uv[:, 1] - uv[:, 1].mean()) / SIZE[1]
        turned = Rotation.from_rotvec(late[:, None] * turn).apply(points)
        uv = project(turned)
    return uv


def cockled(size: float, seed: int = 0, board: Checkerboard = BOARD) -> Floats:
    """Smooth shifts (corners, 3) of the board's corners, squares, of rms ``size`` along each axis; no plane, stretch or
    shear among them.
    """
    at = lattice(board)
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, (3, 2))
    waves = np.stack([np.sin(at[:, 0] / 1.7 + a) * np.cos(at[:, 1] / 1.9 + b) for a, b in phases], axis=1)
    planes = np.column_stack([np.ones(len(at)), at])
    waves -= planes @ np.linalg.lstsq(planes, waves, rcond=None)[0]
    return np.asarray(size * waves / np.sqrt((waves**2).mean(axis=0)))


def true_intrinsics(scene: Scene) -> Floats:
    """(f, uc, vc) of the virtual camera of the first view's board."""
    centre = -scene.rotations[0].T @ scene.translations[0]
    return np.array([-centre[2], centre[0], centre[1]])


def ray_errors_px(scene: Scene, uv: Floats, directions: Floats) -> Floats:
    """Errors (n,) of rays of pixels ``uv`` in the first board's frame, after the best rotation, in px."""
    from scipy.optimize import least_squares

    def seen(vector: Floats) -> Floats:
        return (scene.project(Rotation.from_rotvec(vector).apply(directions)) - uv).ravel()

    start = Rotation.from_matrix(scene.rotations[0]).as_rotvec()
    return np.linalg.norm(least_squares(seen, start).fun.reshape(-1, 2), axis=1)


@pytest.fixture(scope="session")
def scenes() -> dict[str, Scene]:
    return {name: make_scene(name) for name in LENSES}
