"""The paper's two large figures, drawn with matplotlib (an optional dependency)."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pinholify.errors import OutputError
from pinholify.io.files import atomic_path
from pinholify.reproduction.chain import Reproduced
from pinholify.reproduction.drawing import PinholeDrawing, collinearity_drawing, pinhole_drawing
from pinholify.reproduction.pictures import Row

DPI = 200
INK, LINE, DOT = "#222222", "#3b6ea5", "#b0342c"
COLUMNS = (
    "photograph",
    "collinearity, virtual plane",
    "OpenCV, 5 parameters",
    "paper: splat, constant mean",
    "ours: remap, default trend",
)


def require_matplotlib() -> None:
    """Raise OutputError where matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise OutputError(
            "the figures are drawn with matplotlib, which is not installed; install it with: "
            "pip install 'pinholify[figures]'"
        )


def write_images_figure(path: Path, results: Sequence[Reproduced], rows: Sequence[Row]) -> None:
    """The paper's figure of all data sets, one row each: board, collinearity, OpenCV's straightening, splat, remap."""
    from matplotlib.figure import Figure

    heights = [row.photograph.shape[0] / row.photograph.shape[1] for row in rows]
    figure = Figure(figsize=(15, 2.95 * sum(heights) + 0.25 * len(rows) + 0.3), layout="constrained")
    axes = figure.subplots(len(rows), len(COLUMNS), squeeze=False, height_ratios=heights)
    for line, result, row in zip(axes, results, rows, strict=True):
        pictures = (row.photograph, None, row.opencv, row.splat, row.remap)
        for cell, picture in zip(line, pictures, strict=True):
            if picture is not None:
                cell.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="antialiased")
            _bare(cell)
        _draw_collinearity(line[1], row)
        line[0].set_ylabel(result.dataset.title, fontsize=11)
    for cell, title in zip(axes[0], COLUMNS, strict=True):
        cell.set_title(title, fontsize=11)
    _save(figure, path)


def _bare(cell: Any) -> None:
    cell.set_xticks([])
    cell.set_yticks([])
    for spine in cell.spines.values():
        spine.set_visible(False)


def _draw_collinearity(cell: Any, row: Row) -> None:
    """Best-fit lines, the points, and their magnified deviations from the lines."""
    from matplotlib.collections import LineCollection

    drawing = collinearity_drawing(row.board.board.lattice, row.board.board.xy)
    cell.add_collection(LineCollection(list(drawing.lines), colors=LINE, linewidths=0.6))
    cell.add_collection(LineCollection(list(drawing.deviations), colors=DOT, linewidths=0.9))
    cell.plot(*drawing.points.T, ".", color=INK, markersize=2.0)
    cell.margins(0.04)
    cell.set_aspect("equal", adjustable="datalim")
    cell.invert_yaxis()
    cell.set_xlabel(f"red: deviations ×{drawing.magnification:,.0f}", fontsize=9)


def write_pinhole_figure(path: Path, results: Sequence[Reproduced]) -> None:
    """The paper's figure of 100 lines of sight per data set in 3D, with a close-up of where they meet."""
    from matplotlib.figure import Figure

    shown = [r for r in results if r.paper.evaluation.lines is not None]
    columns = min(3, max(1, len(shown)))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(5.2 * columns, 3.7 * rows), layout="constrained")
    panels = np.ravel(figure.subfigures(rows, columns, squeeze=False))
    for letter, panel, result in zip("abcdefghijkl", panels, shown, strict=False):
        evaluation = result.paper.evaluation
        assert evaluation.lines is not None
        drawing = pinhole_drawing(evaluation.lines, evaluation.calibration.camera.intrinsics.f)
        panel.suptitle(f"({letter}) {result.dataset.title}", fontsize=11)
        _draw_pencil(panel.add_axes((0.0, 0.0, 0.7, 0.92), projection="3d"), drawing)
        _draw_meeting_point(panel.add_axes((0.735, 0.3, 0.25, 0.4)), drawing, evaluation.pinholeness)
    _save(figure, path)


def _draw_pencil(cell: Any, drawing: PinholeDrawing) -> None:
    """The lines with one scale on all axes: depth to the right, the image's y down; dots mark their ends."""
    placed = drawing.segments[:, :, [2, 0, 1]] * [1.0, 1.0, -1.0]
    for segment in placed:
        cell.plot(*segment.T, color=LINE, linewidth=0.45)
    cell.scatter(*placed[:, 1].T, color=INK, s=1.5, depthshade=False)
    cell.scatter([0], [0], [0], color=DOT, s=16, depthshade=False)
    low, high = placed.min(axis=(0, 1)), placed.max(axis=(0, 1))
    cell.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    cell.set_box_aspect(high - low, zoom=0.98)
    cell.view_init(elev=18, azim=-55)
    cell.locator_params(nbins=4)
    cell.tick_params(labelsize=6, pad=-2)


def _draw_meeting_point(cell: Any, drawing: PinholeDrawing, pinholeness: float | None) -> None:
    """Where the lines cross the plane through the origin, at a separate scale."""
    half = 1.15 * float(np.abs(drawing.crossings).max()) or 1.0
    cell.plot(*drawing.crossings.T, ".", color=LINE, markersize=2.5)
    cell.plot(0, 0, "+", color=DOT, markersize=9)
    cell.set(xlim=(-half, half), ylim=(half, -half), aspect="equal", xticks=[], yticks=[])
    cell.set_title(f"at z = 0: ±{half:.1e} f", fontsize=8, pad=3)
    cell.set_xlabel(f"mean distance\n{pinholeness:.1e} f", fontsize=8)


def _save(figure: Any, path: Path) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=DPI, facecolor="white")
