"""Captured folders to the corners of one camera: decoded, fitted at the nodes, and checked against each other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter

from pinholify.arrays import Bools, Floats
from pinholify.board import Screen, size
from pinholify.calibration.condensing import predicted_by_neighbours
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.detection.files import unique_names
from pinholify.detection.gray_code.captures import capture_paths, read_captures
from pinholify.detection.gray_code.nodes import Nodes, fit_nodes, least_spacing
from pinholify.detection.gray_code.patterns import Sequence
from pinholify.detection.gray_code.screen_map import ScreenMap, decode
from pinholify.detection.intensity import Grey
from pinholify.errors import ImageError

REACH = 2
"""Nodes on each side from which a node is predicted."""

LIMIT_STDS = 6.0
"""Standard deviations from the neighbours' prediction beyond which a node may be dropped."""

ROUNDS = 12
"""How often the worst node of each neighbourhood may be dropped."""

MIN_NODES = 16
FEW_NODES_SHARE = 0.1
"""Share of a screen's nodes: if fewer are decoded, the spacing is checked."""

WEIGHTS = (0.2, 2.0)
"""Limits of a node's weight, that of a typical one being 1."""

MEDIAN_LENGTH = float(np.sqrt(2.0 * np.log(2.0)))
"""Median length of a two-dimensional normal residual, in standard deviations per axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Decoded:
    """The nodes of all poses as ``corners``; ``std_px`` is the standard deviation per axis of a node of weight 1."""

    corners: CornerSet
    std_px: float


def decode_folders(
    folders: Iterable[str | Path],
    sequence: Sequence,
    *,
    spacing: int = 16,
    on_capture: Callable[[], object] = lambda: None,
    on_pose: Callable[[str, ScreenMap], object] = lambda name, seen: None,
) -> Decoded:
    """The nodes of a screen, ``spacing`` screen pixels apart, as one camera sees them in each of ``folders``.

    Each folder holds the captures of all patterns of ``sequence`` at one pose of the screen, in order. ``on_capture``
    is called once per capture, ``on_pose`` with each pose's name and map of the screen. Raises ImageError for captures
    that are missing, of mixed sizes, without a lit screen, or not in the order of the patterns, and if something moved
    between them; BoardError for an impossible spacing.
    """
    screen = Screen(*sequence.size, spacing)
    paths = [Path(folder) for folder in folders]
    captures = [capture_paths(path, sequence) for path in paths]
    image_size: tuple[int, int] | None = None
    found: list[tuple[str, Nodes, str]] = []
    for name, files in zip(unique_names(paths), captures, strict=True):
        decoded = decode(_counted(read_captures(files, image_size), on_capture), sequence, name)
        image_size = (decoded.x.shape[1], decoded.x.shape[0])
        nodes = fit_nodes(decoded, screen)
        found.append((name, nodes, _why_few(nodes, decoded, screen)))
        on_pose(name, decoded)
    if image_size is None:
        raise ImageError("no folder of captures was given; give one per pose of the screen")
    std = _typical([nodes for _, nodes, _ in found])
    views = [_view(name, nodes, screen, std, why) for name, nodes, why in found]
    return Decoded(CornerSet(screen, image_size, tuple(views)), std)


def _counted(images: Iterable[Grey], on_capture: Callable[[], object]) -> Iterator[Grey]:
    for image in images:
        on_capture()
        yield image


def decode_captures(images: Iterable[Grey], sequence: Sequence, *, spacing: int = 16, name: str = "") -> Decoded:
    """:func:`decode_folders` for one pose, given its captures ``images`` (height, width) float32, 0 … 1."""
    decoded = decode(images, sequence, name)
    screen = Screen(*sequence.size, spacing)
    nodes = fit_nodes(decoded, screen)
    std = _typical([nodes])
    image_size = (decoded.x.shape[1], decoded.x.shape[0])
    view = _view(name, nodes, screen, std, _why_few(nodes, decoded, screen))
    return Decoded(CornerSet(screen, image_size, (view,)), std)


def _typical(found: list[Nodes]) -> float:
    """Median standard deviation (px) of all nodes; 1 where there are none."""
    every = np.concatenate([nodes.std for nodes in found])
    return float(np.median(every)) if len(every) else 1.0


def _why_few(nodes: Nodes, decoded: ScreenMap, screen: Screen) -> str:
    """Why there are so few ``nodes``, and what to do, for the message."""
    spacing, least = screen.spacing, screen.spacing
    if len(nodes.ids) < MIN_NODES + FEW_NODES_SHARE * size(screen):
        least = least_spacing(decoded, screen)
    if least > spacing:
        return f"nodes {spacing} screen px apart have too few pixels around them: give a spacing of {least} px or more"
    return "too little of the screen is visible, or too coarsely: let it fill more of the image"


def _view(name: str, nodes: Nodes, screen: Screen, std: float, why: str) -> Corners:
    """The nodes that agree with their neighbours; none, and the reason ``why``, if they are too few."""
    weights = np.clip(std / nodes.std, *WEIGHTS)
    view = without_strangers(Corners(name, nodes.ids, nodes.uv, weights), screen, std)
    if len(view) < MIN_NODES:
        return not_found(name, f"{len(view)} nodes could be decoded; {why}")
    return view


def without_strangers(view: Corners, screen: Screen, std: float) -> Corners:
    """``view`` without nodes that disagree with their neighbours, or have too few of them.

    ``std`` (px) is the standard deviation of a node of weight 1.
    """
    for _ in range(ROUNDS):
        if not len(view):
            break
        uv, variance = predicted_by_neighbours(view, screen, REACH)
        predicted = np.isfinite(variance)
        if not predicted.all():
            view = view.select(predicted)
            continue
        excess = np.linalg.norm(uv - view.uv, axis=1) / (std * np.sqrt(variance + view.weights**-2.0))
        scale = max(1.0, float(np.median(excess)) / MEDIAN_LENGTH)
        wrong = (excess > LIMIT_STDS * scale) & _worst_around(view, screen, excess)
        if not wrong.any():
            break
        view = view.select(~wrong)
    return view


def _worst_around(view: Corners, screen: Screen, excess: Floats) -> Bools:
    """Which nodes (n,) have the largest ``excess`` (n,) of those within REACH."""
    row, column = np.divmod(view.ids, screen.columns)
    grid = np.zeros((screen.rows, screen.columns))
    grid[row, column] = excess
    return np.asarray(excess >= maximum_filter(grid, 2 * REACH + 1)[row, column])
