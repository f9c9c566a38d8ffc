"""The figures as numbers: fitted lines and deviations of a board, and lines of sight near the origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.evaluation.measures import PinholeLines, board_lines, line_feet, mean_spacing, plane_crossings
from pinholify.report.numerals import round_down

SHOWN_DEVIATION = 0.25  # largest length of the RMS deviation as drawn, as a fraction of the corner spacing
FAR = 80.0  # percentile of the depths of points on boards at which the lines end
BEHIND = 0.25  # length of the lines behind the origin, as a fraction of that in front


@dataclass(frozen=True, slots=True, eq=False)
class CollinearityDrawing:
    """Points (n, 2), best-fit lines (k, 2 ends, 2) and deviations (m, 2 ends, 2) of the points from them, in squares.

    The deviations are drawn ``magnification`` times as long.
    """

    points: Floats
    lines: Floats
    deviations: Floats
    magnification: float


def collinearity_drawing(lattice: Floats, points: Floats) -> CollinearityDrawing:
    """The best-fit lines of a board's rows and columns; ``points`` (n, 2) in the virtual plane."""
    lines = board_lines(lattice, points)
    feet = [line_feet(line) for line in lines]
    foot = np.concatenate(feet)
    error = np.concatenate(lines) - foot
    rms = np.sqrt((error**2).sum(axis=1).mean())
    magnification = round_down(SHOWN_DEVIATION * mean_spacing(lattice, points) / rms) if rms > 0 else 1.0
    deviations = np.stack([foot, foot + magnification * error], axis=1)
    return CollinearityDrawing(points, np.array([foot[[0, -1]] for foot in feet]), deviations, magnification)


@dataclass(frozen=True, slots=True, eq=False)
class PinholeDrawing:
    """Lines of sight in units of f: ``segments`` (n, 2 ends, 3) from behind the origin to a common depth.

    ``crossings`` (n, 2) are where they cross the plane z = 0: at the origin for a pinhole camera.
    """

    segments: Floats
    crossings: Floats


def pinhole_drawing(lines: PinholeLines, f: float) -> PinholeDrawing:
    """The drawing of ``lines``, whose unit is squares, for a camera with focal length ``f`` in squares."""
    forward = lines.directions / lines.directions[:, 2:]
    at_zero = plane_crossings(lines.anchors, lines.directions)
    far = float(np.percentile(np.concatenate(lines.points)[:, 2], FAR))
    ends = np.stack([at_zero - BEHIND * far * forward, at_zero + far * forward], axis=1)
    return PinholeDrawing(ends / f, at_zero[:, :2] / f)
