"""The pages' pictures, rendered by the project's own simulator and printer into ``generated/`` before a build."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from sphinx.application import Sphinx

from pinholify.board import Checkerboard, lattice, parse_board
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet
from pinholify.geometry import Pose
from pinholify.io.board_print import write_board
from pinholify.io.images import write_image
from pinholify.pipeline import calibrate
from pinholify.simulation.lenses import BrownConrady, Fisheye, Lens, Mirror, Pinhole, WaterPane, bumpy
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import board_poses, true_corners

Image = NDArray[np.uint8]

BOARD = Checkerboard(9, 6)
SIZE = (400, 300)
LENS = BrownConrady(SIZE, (260.0, 260.0), radial=(-0.2, 0.03, 0.0))
FISHEYE = Fisheye(SIZE, 165.0, (0.02, -0.008, 0.001, 0.0))
STRANGE: dict[str, Lens] = {
    "fisheye": FISHEYE,
    "windscreen": bumpy(FISHEYE, count=12, width=40.0, shift=5.0, seed=3),
    "water": WaterPane(Pinhole(SIZE, 280.0), 0.8, 0.3, (0.05, -0.08, 1.0)),
    "mirror": Mirror(Pinhole(SIZE, 400.0), 12.0, 0.01, 0.0003, 9.0, tilt=25.0),
}
BOARDS = {
    "checkerboard": ("9x6", 20.0),
    "charuco": ("charuco:9x7:DICT_4X4_100:0.75", 20.0),
    "aprilgrid": ("aprilgrid:6x4:tag36h11:0.3", 25.0),
    "circles": ("circles:7x5", 25.0),
    "circles-asymmetric": ("circles:4x7:asymmetric", 20.0),
}
NOISE = 0.1  # px
VIEWS = 8
GAP = 6  # px between the pictures of a sheet


def good_poses() -> tuple[Pose, ...]:
    """One board that fills the frame, the others tilted and out to the corners."""
    return board_poses((LENS,), BOARD, VIEWS, seed=9)


def poor_poses() -> tuple[Pose, ...]:
    """Boards far away, in the middle and hardly tilted, which calibrate poorly."""
    rng = np.random.default_rng(0)
    turns = Rotation.from_euler("xyz", rng.normal(0.0, 3.0, (VIEWS, 3)), degrees=True).as_matrix()
    middle = np.append(lattice(BOARD).mean(axis=0), 0.0)
    places = np.column_stack([rng.uniform(-1.5, 1.5, VIEWS), rng.uniform(-1.0, 1.0, VIEWS), rng.uniform(17, 20, VIEWS)])
    return tuple(Pose(turn, place - turn @ middle) for turn, place in zip(turns, places, strict=True))


def take(lens: Lens, poses: Iterable[Pose], sensor: Sensor | None = None, board: Checkerboard = BOARD) -> list[Image]:
    """A photograph (h, w) of the board at each of ``poses``."""
    rays, texture = pixel_rays(lens), CheckerboardTexture(board)
    sensor = sensor or Sensor(vignetting=0.2, shot_noise=2.0, read_noise=1.0)
    scenes = [Scene((TexturedPlane(pose, texture),), cloudy(0.45, seed=1)) for pose in poses]
    return [photograph(render(rays, scene, samples=13), sensor, i) for i, scene in enumerate(scenes)]


def sheet(images: list[Image], columns: int) -> Image:
    """``images`` of one size in rows of ``columns``, white between them."""
    framed = [np.pad(image, ((0, GAP), (0, GAP)), constant_values=255) for image in images]
    rows = [np.hstack(framed[i : i + columns]) for i in range(0, len(framed), columns)]
    return np.asarray(np.vstack(rows)[:-GAP, :-GAP])


def good_set(path: Path) -> None:
    """Write the sheet of good photographs."""
    write_image(path, sheet(take(LENS, good_poses()), 4))


def poor_set(path: Path) -> None:
    """Write the sheet of poor photographs."""
    write_image(path, sheet(take(LENS, poor_poses()), 4))


def faults(path: Path) -> None:
    """The reference board sharp, moved, and overexposed."""
    (sharp,) = take(LENS, good_poses()[:1])
    moved = cv2.blur(sharp, (9, 1))
    bright = np.clip(sharp.astype(np.float64) * 1.9, 0, 255)
    glare = cv2.GaussianBlur(bright, (0, 0), 2.5).clip(0, 255).astype(np.uint8)
    write_image(path, sheet([sharp, moved, glare], 3))


def calibrated(poses: tuple[Pose, ...]) -> Calibration:
    """The camera calibrated from noisy corners of boards at ``poses``."""
    rng = np.random.default_rng(0)
    views = []
    for i, pose in enumerate(poses):
        uv = true_corners(LENS, BOARD, pose)
        views.append(Corners(f"view-{i}", np.arange(len(uv)), uv + rng.normal(0.0, NOISE, uv.shape)))
    return calibrate(CornerSet(BOARD, SIZE, tuple(views)))


def what_is_known(path: Path) -> None:
    """The standard deviation over the image, in px, after the good and after the poor set."""
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    u, v = np.meshgrid(np.arange(0, SIZE[0], 4), np.arange(0, SIZE[1], 4))
    pixels = np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
    for axis, poses, name in zip(axes, (good_poses(), poor_poses()), ("good set", "poor set"), strict=True):
        made = calibrated(poses)
        std = made.camera.shape_std(pixels).reshape(u.shape)
        drawn = axis.pcolormesh(u, v, std, norm="log", vmin=0.01, vmax=3.0, cmap="viridis", shading="nearest")
        for view in made.corner_set.views:
            axis.plot(*view.uv.T, ".", color="white", markersize=1.5)
        focal = made.intrinsics_std[0] / made.camera.intrinsics.f
        axis.set(title=f"{name}: f known to {100 * focal:.2g} %", xlim=(0, SIZE[0]), ylim=(SIZE[1], 0), aspect="equal")
    figure.colorbar(drawn, ax=axes, label="standard deviation, px", extend="both")
    figure.savefig(path, dpi=110)


def strange(name: str) -> Callable[[Path], None]:
    """A function that writes photographs of a board through the lens ``name``."""

    def draw(path: Path) -> None:
        lens = STRANGE[name]
        write_image(path, sheet(take(lens, board_poses((lens,), BOARD, 3, seed=2, tilt=30.0)), 3))

    return draw


def printed(name: str) -> Callable[[Path], None]:
    """A function that writes the printed sheet of the board ``name``."""

    def draw(path: Path) -> None:
        spec, square = BOARDS[name]
        write_board(parse_board(spec), path, square_mm=square)

    return draw


PICTURES: dict[str, Callable[[Path], None]] = {
    "good-set.png": good_set,
    "poor-set.png": poor_set,
    "faults.png": faults,
    "what-is-known.png": what_is_known,
    **{f"strange-{name}.png": strange(name) for name in STRANGE},
    **{f"board-{name}.svg": printed(name) for name in BOARDS},
}


def _draw(app: Sphinx) -> None:
    """Draw pictures that are missing or older than this file."""
    folder = Path(app.srcdir) / "generated"
    folder.mkdir(exist_ok=True)
    written = Path(__file__).stat().st_mtime
    for name, draw in PICTURES.items():
        path = folder / name
        if not path.exists() or path.stat().st_mtime < written:
            draw(path)


def setup(app: Sphinx) -> dict[str, Any]:
    """Draw before anything is read."""
    app.connect("builder-inited", _draw)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
