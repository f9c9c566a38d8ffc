"""The paper's measures: collinearity error (CE), reprojection error (RE) and pinholeness.

CE is the mean over all rows and columns (of at least three corners) of all counted boards: the RMS distance of a line's
corners from their total-least-squares line, divided by the distance of its end corners. RE of a board is the RMS
distance of its corners from where they are predicted, divided by the mean spacing of adjacent corners in the same
plane; RE is the root mean square over counted boards, in per cent.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats, Ints
from pinholify.calibration.observation import ObservedBoard
from pinholify.camera import VirtualCamera
from pinholify.charts import Intrinsics
from pinholify.geometry import apply_homography, line_distances

LINES_EACH_WAY = 10
INLIER = 2.5  # robust standard deviations
PAIRS = 60


def board_lines(lattice: Floats, points: Floats) -> list[Floats]:
    """The rows and columns with at least three points of a board, each (k, 2), in lattice order."""
    return [points[line] for line in _lines(lattice) if len(line) >= 3]


def _lines(lattice: Floats) -> list[Ints]:
    """The indices of the points of each row and column, in lattice order."""
    lines = []
    for along, across in ((0, 1), (1, 0)):
        order = np.lexsort((lattice[:, along], lattice[:, across]))
        breaks = np.flatnonzero(np.diff(lattice[order, across])) + 1
        lines += np.split(order, breaks)
    return lines


def line_feet(points: Floats) -> Floats:
    """Feet (n, d) of the perpendiculars from ``points`` (n, d) to their total-least-squares line."""
    centre = points.mean(axis=0)
    direction = np.linalg.svd(points - centre, full_matrices=False)[2][0]
    return np.asarray(centre + np.outer((points - centre) @ direction, direction))


def collinearity_errors(lattice: Floats, points: Floats) -> Floats:
    """Collinearity error of each row and column, unitless.

    ``points`` (n, 2) lie in any plane; ``lattice`` (n, 2) are their lattice coordinates.
    """
    return np.array(
        [
            np.sqrt((line_distances(line) ** 2).mean()) / np.linalg.norm(line[-1] - line[0])
            for line in board_lines(lattice, points)
        ]
    )


def mean_spacing(lattice: Floats, points: Floats) -> float:
    """Mean distance of horizontally and vertically adjacent points of a board, per square, in units of ``points``.

    Adjacent points are the nearest that the lattice has: one square apart on a checkerboard, the ends of a gap on an
    AprilGrid, two units apart in an asymmetric circle grid.
    """
    pairs = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in _lines(lattice)])
    first, second = pairs.T
    squares = np.linalg.norm(lattice[first] - lattice[second], axis=1)
    adjacent = squares < 1.01 * squares.min()
    apart = np.linalg.norm(points[first] - points[second], axis=1)
    return float((apart[adjacent] / squares[adjacent]).mean())


def closed_form_percent(observed: ObservedBoard, intrinsics: Intrinsics) -> float:
    """RE of a board with its closed-form pose, in the virtual plane, %."""
    board = observed.board
    return _percent(observed, intrinsics.project(observed.closed_form.apply(board.lattice)))


def refined_percent(observed: ObservedBoard) -> float:
    """RE of a board with its refined pose, in the virtual plane, %."""
    return _percent(observed, observed.projected)


def _percent(observed: ObservedBoard, projected: Floats) -> float:
    board = observed.board
    return 100.0 * rms(projected - board.xy) / mean_spacing(board.lattice, board.xy)


def rms(errors: Floats) -> float:
    """Root mean square length of ``errors`` (n, 2); nan if there are none."""
    return float(np.sqrt((errors**2).sum(axis=1).mean())) if len(errors) else float("nan")


def root_mean_square(values: Iterable[float]) -> float:
    """Root mean square of ``values``; nan if there are none."""
    array = np.array(list(values))
    return float(np.sqrt((array**2).mean())) if len(array) else float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class PinholeLines:
    """Lines of sight of about 100 pixels, each fitted to the pixel's points on all board planes.

    ``points`` (k, 3) of each line; ``anchors`` and ``directions`` (n, 3), in squares in the camera's frame;
    ``distances`` (n,) of the lines from the origin, in units of f.
    """

    points: tuple[Floats, ...]
    anchors: Floats
    directions: Floats
    distances: Floats


def plane_crossings(anchors: Floats, directions: Floats) -> Floats:
    """Points (n, 3) where lines through ``anchors`` (n, 3) along ``directions`` (n, 3) cross the plane z = 0."""
    return np.asarray(anchors - anchors[:, 2:] / directions[:, 2:] * directions)


def pinhole_lines(camera: VirtualCamera, boards: Sequence[ObservedBoard]) -> PinholeLines | None:
    """Lines of sight of 10 × 10 pixels through their points on every board (paper, section 3); None below three boards.

    A pixel's point on board k is its virtual point mapped by H_k⁻¹ and the closed-form pose.
    """
    if len(boards) < 3:
        return None
    pixels = pixel_grid(camera)
    virtual = camera.virtual_points(pixels)
    on_boards = np.stack(
        [o.closed_form.apply(apply_homography(_inverse(o.board.homography), virtual)) for o in boards], axis=1
    )
    rays = camera.to_rays(pixels).directions
    points, lines = [], []
    for seen, ray in zip(on_boards, rays, strict=True):
        ahead = seen[(seen @ ray > 0) & np.isfinite(seen).all(axis=1)]
        if len(ahead) >= 3:
            points.append(ahead)
            lines.append(_robust_line(ahead))
    if not lines:
        return None
    anchors, directions = (np.array(part) for part in zip(*lines, strict=True))
    distances = np.linalg.norm(np.cross(anchors, directions), axis=1) / camera.intrinsics.f
    return PinholeLines(tuple(points), anchors, directions, distances)


def _inverse(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def pixel_grid(camera: VirtualCamera) -> Floats:
    """About 10 × 10 pixels (n, 2) spread over the camera's domain."""
    low, high = camera.domain.hull.vertices.min(axis=0), camera.domain.hull.vertices.max(axis=0)
    for lines in range(LINES_EACH_WAY, 3 * LINES_EACH_WAY):
        share = (np.arange(lines) + 0.5) / lines
        grid = low + (high - low) * np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
        grid = grid[camera.inside(grid)]
        if len(grid) >= LINES_EACH_WAY**2:
            break
    chosen = np.linspace(0, len(grid) - 1, min(len(grid), LINES_EACH_WAY**2)).round().astype(int)
    return np.asarray(grid[chosen])


def _robust_line(points: Floats) -> tuple[Floats, Floats]:
    """Anchor and direction of a line through ``points`` (k, 3): least median of distances, then least squares.

    Distances are relative to the depth, since points on far planes are less accurate.
    """
    depth = np.linalg.norm(points, axis=1)
    first, second = np.triu_indices(len(points), 1)
    chosen = np.linspace(0, len(first) - 1, min(len(first), PAIRS)).round().astype(int)
    start, along = points[first[chosen]], points[second[chosen]] - points[first[chosen]]
    length = np.linalg.norm(along, axis=1)
    start, along = start[length > 1e-9], along[length > 1e-9] / length[length > 1e-9, None]
    if not len(start):
        return points.mean(axis=0), points[0] / depth[0]
    distances = np.linalg.norm(np.cross(points - start[:, None], along[:, None]), axis=2) / depth
    medians = np.median(distances, axis=1)
    nearest = int(medians.argmin())
    best = distances[nearest] <= max(INLIER * 1.4826 * float(medians[nearest]), 1e-12)
    kept = points[best]
    anchor = kept.mean(axis=0)
    return anchor, np.linalg.svd(kept - anchor, full_matrices=False)[2][0]
