"""What the figures draw, as numbers: fitted lines and deviations of a board, lines of sight near the origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pinholify.arrays import Floats
from pinholify.evaluation.measures import PinholeLines, board_lines, mean_spacing

SHOWN_DEVIATION = 0.25  # of the spacing: how long the RMS deviation is drawn at most
FAR = 80.0  # per cent of the points on boards lie nearer than where the lines end
BEHIND = 0.25  # of a line's length: how far it is drawn beyond the origin


@dataclass(frozen=True, slots=True, eq=False)
class CollinearityDrawing:
    """Points (n, 2), best-fit lines and magnified deviations from them (each (k, 2 ends, 2)), all in squares.

    ``magnification`` says how much longer than true the deviations are.
    """

    points: Floats
    lines: Floats
    deviations: Floats
    magnification: float


def collinearity_drawing(lattice: Floats, points: Floats) -> CollinearityDrawing:
    """The best-fit lines of a board's rows and columns; ``points`` (n, 2) in the virtual plane."""
    lines, feet, errors = [], [], []
    for line in board_lines(lattice, points):
        centre = line.mean(axis=0)
        direction = np.linalg.svd(line - centre, full_matrices=False)[2][0]
        foot = centre + np.outer((line - centre) @ direction, direction)
        lines.append(foot[[0, -1]])
        feet.append(foot)
        errors.append(line - foot)
    foot, error = np.concatenate(feet), np.concatenate(errors)
    rms = np.sqrt((error**2).sum(axis=1).mean())
    magnification = round_down(SHOWN_DEVIATION * mean_spacing(lattice, points) / rms) if rms > 0 else 1.0
    return CollinearityDrawing(
        points, np.array(lines), np.stack([foot, foot + magnification * error], axis=1), magnification
    )


def round_down(value: float) -> float:
    """The largest of …, 1, 2, 5, 10, … that is at most ``value`` > 0."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(m for m in (1.0, 2.0, 5.0) if m * power <= value * (1 + 1e-12)))


@dataclass(frozen=True, slots=True, eq=False)
class PinholeDrawing:
    """Lines of sight: ``segments`` (n, 2 ends, 3) from a little behind the origin to one depth, in units of f.

    ``crossings`` (n, 2): where they cut the plane z = 0 through the origin; at the origin itself for a pinhole camera.
    """

    segments: Floats
    crossings: Floats


def pinhole_drawing(lines: PinholeLines, f: float) -> PinholeDrawing:
    """``lines`` of the camera frame, as they are drawn."""
    forward = lines.directions / lines.directions[:, 2:]
    at_zero = lines.anchors - lines.anchors[:, 2:] * forward
    far = float(np.percentile(np.concatenate(lines.points)[:, 2], FAR))
    ends = np.stack([at_zero - BEHIND * far * forward, at_zero + far * forward], axis=1)
    return PinholeDrawing(ends / f, at_zero[:, :2] / f)
