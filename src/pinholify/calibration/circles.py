"""Circle grids: from the centroids of the discs' images to the images of the discs' centres.

The centroid of a disc's image is not the image of its centre, neither under perspective nor under lens distortion; the
difference grows with the square of the disc's diameter and can reach pixels. A first correction uses the curvature of
the lattice in the image alone. Once a camera is known, the difference is predicted from the board's pose instead.
(Heikkilä, *Geometric camera calibration using circular control points*, 2000, for perspective; here the camera projects
the outline itself, whatever the lens.)
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.board import CircleGrid
from pinholify.calibration.observation import MINIMUM_CORNERS, estimate_pose, sighting_of
from pinholify.calibration.result import Calibration, flat
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, CornerSet

NEIGHBOURS = 13  # points, a disc's own included, of the quadratic that gives the curvature of the lattice there
OUTLINE_POINTS = 16  # of a disc
CENTRING_ROUNDS = 2  # a pose from centroids is slightly off; that of the second round is from centres


def centred(corner_set: CornerSet, calibration: Calibration) -> CornerSet:
    """``corner_set`` with true centres, as the camera of ``calibration`` projects them.

    Photographs that the calibration was made from keep the corners it has of them. Corners of boards other than circle
    grids, and centres already corrected, are returned unchanged.
    """
    if not needs_centres(corner_set):
        return corner_set
    moved = true_centres(corner_set, calibration.camera)
    return moved.with_views(_known(view, calibration.known(view)) for view in moved.views)


def needs_centres(corner_set: CornerSet) -> bool:
    """Whether the corners are centroids of discs that are yet to be corrected."""
    return isinstance(corner_set.board, CircleGrid) and not corner_set.centred


def local_centres(corner_set: CornerSet) -> CornerSet:
    """``corner_set`` with the discs' centroids corrected to their centres by the curvature of the lattice.

    If u(x) maps the lattice to the image, with Jacobian J, the centroid of a disc of radius r is, to second order,
    u + r²/8 ∇²u + r²/4 J ∇log det J; the derivatives are those of a quadratic through the nearest points.
    """
    board = corner_set.board
    if not isinstance(board, CircleGrid):
        return corner_set
    views = tuple(_moved_by_neighbours(view, board) for view in corner_set.views)
    return replace(corner_set, views=views, centred=True)


def true_centres(corner_set: CornerSet, camera: VirtualCamera) -> CornerSet:
    """``corner_set`` with the discs' centroids corrected to where ``camera`` projects the discs' centres."""
    board = corner_set.board
    if not isinstance(board, CircleGrid):
        return corner_set
    views = tuple(_moved(view, board, camera) for view in corner_set.views)
    return replace(corner_set, views=views, centred=True)


def _known(view: Corners, known: Corners | None) -> Corners:
    return view if known is None or not np.array_equal(view.ids, known.ids) else replace(known, name=view.name)


def _moved_by_neighbours(view: Corners, board: CircleGrid) -> Corners:
    if len(view) < NEIGHBOURS:
        return view
    lattice = view.lattice(board)
    near = cKDTree(lattice).query(lattice, k=NEIGHBOURS)[1]
    x, y = (lattice[near] - lattice[:, None]).transpose(2, 0, 1)
    design = np.stack([np.ones_like(x), x, y, x * x / 2.0, x * y, y * y / 2.0], axis=2)
    fit = np.linalg.pinv(design) @ view.uv[near]  # (n, 6, 2): u, its two first and its three second derivatives
    jacobian, hessian = fit[:, 1:3].transpose(0, 2, 1), fit[:, [3, 4, 4, 5]].reshape(-1, 2, 2, 2)
    bending = hessian[:, 0, 0] + hessian[:, 1, 1]
    # ∂ log det J/∂x_i = trace(J⁻¹ ∂J/∂x_i)
    growth = np.einsum("njk,nijk->ni", np.linalg.pinv(jacobian), hessian)
    shift = bending / 8.0 + (jacobian @ growth[:, :, None])[:, :, 0] / 4.0
    return replace(view, uv=view.uv - (board.diameter / 2.0) ** 2 * shift)


def _moved(view: Corners, board: CircleGrid, camera: VirtualCamera) -> Corners:
    """``view`` with centres in place of centroids; unchanged where too few lie in the camera's domain for a pose."""
    lattice, uv = view.lattice(board), view.uv
    for _ in range(CENTRING_ROUNDS):
        inside = camera.inside(uv) if len(uv) else np.zeros(0, dtype=bool)
        if inside.sum() < MINIMUM_CORNERS:
            return view
        pose, _ = estimate_pose(camera, sighting_of(camera, flat(lattice[inside]), uv[inside]))
        centre, ring = (
            camera.project(pose.apply(flat(points.reshape(-1, 2)))).reshape(len(uv), -1, 2)
            for points in (lattice, _outlines(lattice, board.diameter))
        )
        shift = centre[:, 0] - centroids_inside(ring)
        uv = view.uv + np.where(np.isfinite(shift), shift, 0.0)
    return replace(view, uv=uv)


def _outlines(centres: Floats, diameter: float) -> Floats:
    """Points (n, OUTLINE_POINTS, 2) on circles about ``centres`` (n, 2)."""
    angle = np.arange(OUTLINE_POINTS) * (2 * np.pi / OUTLINE_POINTS)
    return np.asarray(centres[:, None] + diameter / 2.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1))


def centroids_inside(outlines: Floats) -> Floats:
    """Centroids (n, 2) of the areas inside smooth closed curves through ``outlines`` (n, k, 2).

    The points are evenly spaced in the curves' parameter. The trigonometric curves through them are integrated;
    polygons through the same points would miss a hundredth of the shift of a disc's centroid.
    """
    middle = outlines.mean(axis=1, keepdims=True)
    place = outlines - middle
    harmonics = np.fft.rfft(place, axis=1)
    count = outlines.shape[1]
    slope = np.fft.irfft(1j * np.arange(harmonics.shape[1])[:, None] * harmonics, n=count, axis=1)
    swept = place[:, :, 0] * slope[:, :, 1] - place[:, :, 1] * slope[:, :, 0]  # twice the area, per parameter
    moment = (place * swept[:, :, None]).sum(axis=1)
    return np.asarray(middle[:, 0] + moment / (1.5 * swept.sum(axis=1))[:, None])
