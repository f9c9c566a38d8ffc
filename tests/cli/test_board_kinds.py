"""Each kind of board through the command line: printed, photographed, found, and a camera within its error bars."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pinholify.board import parse_board
from pinholify.io.board_print import ARTWORKS
from pinholify.io.images import write_image
from pinholify.simulation.lenses import LENSES, Lens, Pinhole, Resized
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import Picture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import board_poses, virtual_camera

SQUARE = 240  # px of the printed page: 20.32 mm at 300 dpi, a whole number of them a tag's cell and a gap
MM = "20.32mm"


def printed_page(run, path: Path, spec: str) -> Picture:
    """The page that ``pinholify board`` writes, as a picture on a plane whose origin is the board's point 0."""
    done = run("board", spec, "--square", MM, "--page", "A3", "-o", str(path))
    assert done.status == 0, done.err
    page = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    artwork = ARTWORKS[type(parse_board(spec))](parse_board(spec))
    body = page[: -SQUARE]  # without the footer
    dark = np.argwhere(body < 128)
    top, left = dark.min(axis=0)
    assert (np.ptp(dark, axis=0) + 1 == np.rint([artwork.rows * SQUARE, artwork.columns * SQUARE])).all()
    grey = (0.07 + 0.83 * page / 255.0).astype(np.float32)[:, :, None]
    origin = (0.5 - np.array([left, top])) / SQUARE - artwork.origin
    return Picture(grey, SQUARE, (float(origin[0]), float(origin[1])))


def photographs(folder: Path, lens: Lens, texture: Picture, spec: str, count: int) -> np.ndarray:
    """Writes ``count`` photographs and returns the true f, uc, vc of the first one's board."""
    rays = pixel_rays(lens)
    margin = {"aprilgrid": 0.013, "circles:7": 0.05}.get(spec[:9], 0.025)  # circles reach beyond their centres
    poses = board_poses([lens], parse_board(spec), count, seed=7, margin=margin, tilt=38.0)
    folder.mkdir()
    for i, pose in enumerate(poses):
        picture = render(rays, Scene((TexturedPlane(pose, texture),), cloudy(0.4)), samples=31)
        image = photograph(picture, Sensor(blur=0.8, shot_noise=2.0, read_noise=1.5), i)
        write_image(folder / f"{i}.png", image)
    return np.array(virtual_camera(poses[0]))


def check(run, tmp_path: Path, spec: str, lens: Lens, count: int) -> None:
    texture = printed_page(run, tmp_path / "board.png", spec)
    truth = photographs(tmp_path / "photos", lens, texture, spec, count)
    found = run("detect", str(tmp_path / "photos"), "--board", spec, "-o", str(tmp_path / "c.vnl"), "--json",
                "--workers", "1")
    assert found.status == 0, found.err
    board = parse_board(spec)
    images = json.loads(found.out)["images"]
    whole = board.columns * board.rows
    assert sum(image["corners"] == whole for image in images) >= count - 1  # one may lose a row at the image's border
    assert all(image["corners"] > 0.8 * whole for image in images)
    assert all((image["orientation"] == "known") == board.orientable for image in images)
    size = f"{lens.size[0]}x{lens.size[1]}"
    made = run("calibrate", "--corners", str(tmp_path / "c.vnl"), "--image-size", size, "--board", spec, "--reference",
               "0.png", "--no-opencv", "--no-heldout", "--json", "-o", str(tmp_path / "camera.npz"))
    assert made.status == 0, made.err
    result = json.loads(made.out)
    values = np.array([result[k] for k in ("f", "uc", "vc")])
    stds = np.array([result[k] for k in ("f_std", "uc_std", "vc_std")])
    if not board.orientable:  # point 0 may be the board's other end
        ends = np.stack([truth, np.append(truth[0], np.array([board.columns, board.rows]) - 1 - truth[1:])])
        truth = min(ends, key=lambda end: np.abs(values - end).max())
    assert (np.abs(values - truth) < 3.5 * stds).all(), (values, truth, stds)
    assert result["noise_px"] < 0.06


@pytest.mark.parametrize("spec", ["aprilgrid:5x4:tag36h11:0.3", "circles:7x5"])
def test_printed_photographed_and_calibrated(run, tmp_path, spec):
    check(run, tmp_path, spec, Pinhole((640, 480), 480.0), 5)


@pytest.mark.slow
@pytest.mark.parametrize("spec", ["aprilgrid:6x4:tag36h11:0.3", "circles:9x7", "circles:5x9:asymmetric:0.8"])
@pytest.mark.parametrize("name", ["brown-conrady", "fisheye"])
def test_with_a_lens(run, tmp_path, spec, name):
    check(run, tmp_path, spec, Resized(LENSES[name], (960, 720)), 10)
