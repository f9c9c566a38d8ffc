"""A camera that looks at a curved mirror: reflected rays without a single centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Floats, Ints
from pinholify.geometry import Pose
from pinholify.simulation.lenses.base import Lens, LensRays, require_central, unit
from pinholify.simulation.newton import solve


def reflect(directions: Floats, normals: Floats) -> Floats:
    """``directions`` (N, 3) after reflection by mirrors with unit ``normals`` (N, 3)."""
    return np.asarray(directions - 2 * (directions * normals).sum(axis=1, keepdims=True) * normals)


@dataclass(frozen=True, slots=True)
class Mirror:
    """A central ``lens`` in front of the mirror z = ``a`` r² + ``b`` r⁴ of the given ``radius``; lengths in squares.

    The mirror's frame is ``distance`` in front of the camera, on its axis, rotated by ``tilt`` (degrees) about the
    camera's x axis. Its z points away from the camera, so the mirror is convex for a and b of at least zero. Images are
    reversed, and the scene lies on the camera's side. Raises ValueError for a or b below zero, and for a lens without a
    single centre.
    """

    lens: Lens
    distance: float
    a: float
    b: float
    radius: float
    tilt: float = 0.0
    central = False

    def __post_init__(self) -> None:
        """Refuse mirrors that cannot be traced."""
        require_central(self.lens, "a mirror")
        if self.a < 0 or self.b < 0:
            raise ValueError(f"a mirror of a = {self.a}, b = {self.b} is not convex; both must be at least zero")

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image, px."""
        return self.lens.size

    @property
    def _camera_from_mirror(self) -> Pose:
        turn = Rotation.from_euler("x", self.tilt, degrees=True).as_matrix()
        return Pose(turn, np.array([0.0, 0.0, self.distance]))

    def _surface(self, xy: Floats) -> tuple[Floats, Floats, Floats]:
        """Height (N,), slope (N, 2) and its derivative (N, 2, 2) at ``xy`` (N, 2)."""
        s = (xy**2).sum(axis=1)
        first, second = self.a + 2 * self.b * s, 2 * self.b
        slope = 2 * first[:, None] * xy
        hessian = 2 * first[:, None, None] * np.eye(2) + 4 * second * xy[:, :, None] * xy[:, None, :]
        return self.a * s + self.b * s**2, slope, hessian

    def _inside(self, xy: Floats) -> Floats:
        return np.asarray(np.where((xy**2).sum(axis=1, keepdims=True) <= self.radius**2, xy, np.nan))

    def unproject(self, uv: Floats) -> LensRays:
        """The reflected rays of the pixels ``uv`` (N, 2), starting at the mirror; NaN for pixels that miss it."""
        pose = self._camera_from_mirror
        directions = self.lens.unproject(uv).directions @ pose.rotation
        camera = -pose.translation @ pose.rotation

        def above_surface(s: Floats, rows: Ints) -> tuple[Floats, Floats]:
            p, d = camera + s * directions[rows], directions[rows]
            height, slope, _ = self._surface(p[:, :2])
            return (p[:, 2] - height)[:, None], (d[:, 2] - (slope * d[:, :2]).sum(axis=1))[:, None, None]

        # The gap is concave along the ray, so Newton's method starts on the camera's side and finds the first hit.
        s = solve(above_surface, 0 * directions[:, :1], np.zeros((len(uv), 1)))
        hits = camera + s * directions
        hits[:, :2] = self._inside(hits[:, :2])
        _, slope, _ = self._surface(hits[:, :2])
        normals = unit(np.concatenate([slope, -np.ones((len(slope), 1))], axis=1))
        return LensRays(pose.apply(hits), reflect(directions, normals) @ pose.rotation.T)

    def project(self, points: Floats) -> Floats:
        """Pixels (N, 2) of ``points`` (N, 3) in front of the mirror; NaN where it does not show them."""
        pose = self._camera_from_mirror
        camera = -pose.translation @ pose.rotation
        scene = (points - pose.translation) @ pose.rotation
        xy = self._inside(self._reflection_points(camera, scene))
        height, slope, _ = self._surface(xy)
        hits = np.concatenate([xy, height[:, None]], axis=1)
        normals = np.concatenate([slope, -np.ones((len(slope), 1))], axis=1)
        in_front = ((scene - hits) * normals).sum(axis=1) > 0
        return self.lens.project(np.where(in_front[:, None], pose.apply(hits), np.nan))

    def _reflection_points(self, camera: Floats, scene: Floats) -> Floats:
        """The points (N, 2) of the mirror at which light from ``scene`` (N, 3) is reflected to ``camera`` (3,).

        Fermat's principle: the length of the path is stationary, so its gradient over the surface is zero.
        """

        def gradient(xy: Floats, rows: Ints) -> tuple[Floats, Floats]:
            height, slope, bend = self._surface(xy)
            tangents = np.concatenate([np.tile(np.eye(2), (len(xy), 1, 1)), slope[:, :, None]], axis=2)
            hits = np.concatenate([xy, height[:, None]], axis=1)
            value, hessian = np.zeros_like(xy), np.zeros((len(xy), 2, 2))
            for end in (np.broadcast_to(camera, hits.shape), scene[rows]):
                d = hits - end
                length = np.linalg.norm(d, axis=1)
                along = (tangents @ (d / length[:, None])[:, :, None])[:, :, 0]
                metric = tangents @ tangents.transpose(0, 2, 1) - along[:, :, None] * along[:, None, :]
                value += along
                hessian += metric / length[:, None, None] + bend * (d[:, 2] / length)[:, None, None]
            return value, hessian

        # A flat mirror reflects at the point that divides the path in the ratio of the two heights.
        share = (camera[2] / (camera[2] + np.minimum(scene[:, 2], camera[2] / 10)))[:, None]
        return solve(gradient, np.zeros_like(scene[:, :2]), camera[:2] + share * (scene[:, :2] - camera[:2]))
