"""The how-to and use pages: their Python runs as it stands there, on rendered photographs, and finds the truth."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify.board import lattice
from pinholify.geometry import Pose
from pinholify.io.camera_file import write_camera
from pinholify.io.export.base import export_view
from pinholify.io.images import write_image
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.points import undistort_points
from pinholify.rectification.straightener import Straightener
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import true_corners
from small_camera import BOARD, LENS, SIZE

DOCS = Path(__file__).parents[1] / "docs"
SQUARE = 25.0
SHIFT = Pose(Rotation.from_euler("yxz", [-3.0, 1.0, 0.5], degrees=True).as_matrix(), np.array([-1.2, 0.05, 0.02]))
"""The right camera's frame from the left's, in squares."""
FOUND = 1.02
"""How many squares long each square of the board is by the camera's file, as a board may be bent or stretched."""


def python_of(page):
    """The fenced Python of a page, as one program."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return "\n".join(re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE))


def run(page, folder, monkeypatch):
    """The names that the page's program leaves, run in ``folder``."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    names = {"__name__": page}
    exec(compile(python_of(page), page, "exec"), names)
    return names


def board_pose(distance, angles, sideways=(0.0, 0.0)):
    """A board whose middle stands ``distance`` squares ahead."""
    rotation = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    return Pose(rotation, np.array([*sideways, distance]) - rotation[:, :2] @ lattice(BOARD).mean(axis=0))


def take(path, pose):
    scene = Scene((TexturedPlane(pose, CheckerboardTexture(BOARD)),), cloudy(0.45, seed=1))
    write_image(path, photograph(render(pixel_rays(LENS), scene, samples=13), Sensor(read_noise=1.0), 2))


@pytest.fixture(scope="module")
def camera():
    """The small camera without error, so that what is measured is the page's own work."""
    theirs = ForeignCamera("truth", "simulation", "lens", LENS.project, np.full(2, 420.0), np.zeros(2), SIZE)
    adopted = adopt(theirs, board=BOARD)
    points = FOUND * adopted.calibration.board_points
    return dataclasses.replace(adopted, calibration=dataclasses.replace(adopted.calibration, board_points=points))


def test_pose(camera, tmp_path, monkeypatch):
    truth = board_pose(9.0, [20.0, -15.0, 5.0], (0.3, -0.2))
    write_camera(tmp_path / "camera.npz", camera.calibration)
    take(tmp_path / "photo.png", truth)
    found = run("how-to-pose.md", tmp_path, monkeypatch)
    assert found["distance"] == pytest.approx(FOUND * SQUARE * np.linalg.norm(truth.translation), rel=1e-3)
    turn = Rotation.from_rotvec(found["rvec"].ravel()).as_matrix() @ truth.rotation.T
    # In the frame of the last step, which looks along the ray of the image's middle.
    expected = found["view"].rotation
    assert Rotation.from_matrix(turn @ expected.T).magnitude() < 2e-3
    np.testing.assert_allclose(found["tvec"].ravel(), FOUND * SQUARE * expected @ truth.translation, atol=0.5)


def test_triangulation(camera, tmp_path, monkeypatch):
    poses = board_pose(9.0, [10.0, -20.0, 0.0]), board_pose(9.5, [-5.0, 20.0, 3.0])
    write_camera(tmp_path / "camera.npz", camera.calibration)
    points = np.random.default_rng(0).uniform([0, 0, -3], [8, 5, 1], (50, 3))
    for name, pose in zip(("first", "second"), poses, strict=True):
        take(tmp_path / f"{name}.png", pose)
        uv = LENS.project(pose.apply(points))
        np.savetxt(tmp_path / f"{name}.csv", uv, delimiter=",", header="u,v", comments="")
    found = run("how-to-triangulate.md", tmp_path, monkeypatch)
    assert np.linalg.norm(found["points"] - FOUND * SQUARE * points, axis=1).max() < 1.0


def test_stereo(camera, tmp_path, monkeypatch):
    poses = board_pose(9.0, [15.0, -10.0, 0.0], (0.6, 0.0)), board_pose(10.0, [-15.0, 12.0, 3.0], (0.6, 0.2))
    for side in ("left", "right"):
        write_camera(tmp_path / f"{side}.npz", camera.calibration)
    for i, pose in enumerate(poses):
        take(tmp_path / f"left-{i}.png", pose)
        take(tmp_path / f"right-{i}.png", in_right(pose))
    found = run("how-to-stereo.md", tmp_path, monkeypatch)
    turn = found["views"][0].rotation  # the same for both: it is the same camera
    assert Rotation.from_matrix(found["R"] @ turn @ SHIFT.rotation.T @ turn.T).magnitude() < 2e-3
    np.testing.assert_allclose(found["T"].ravel(), FOUND * SQUARE * turn @ SHIFT.translation, atol=0.3)
    left, right = (
        undistort_points(true_corners(LENS, BOARD, pose), camera.calibration.camera, found[R] @ turn, found[P])
        for pose, R, P in ((poses[0], "R1", "P1"), (in_right(poses[0]), "R2", "P2"))
    )
    assert np.abs(left[:, 1] - right[:, 1]).max() < 0.3  # rows agree
    # The depth of the board in the disparity picture, where the matcher found it.
    depth = found["points"][..., 2][tuple(np.rint(left).astype(int).T[::-1])]
    known = (found["disparity"] > 0)[tuple(np.rint(left).astype(int).T[::-1])]
    truth = FOUND * SQUARE * (poses[0].apply(lattice(BOARD)) @ (found["R1"] @ turn).T)[:, 2]
    assert known.mean() > 0.5
    assert np.median(np.abs(depth[known] / truth[known] - 1.0)) < 0.03


@pytest.fixture(scope="module")
def picture():
    """A photograph of the small camera, with corners to find."""
    pose = board_pose(8.0, [10.0, 20.0, 0.0])
    scene = Scene((TexturedPlane(pose, CheckerboardTexture(BOARD)),), cloudy(0.45, seed=1))
    return photograph(render(pixel_rays(LENS), scene, samples=13), Sensor(), 0)


def test_opencv(camera, picture, tmp_path, monkeypatch):
    ours = camera.calibration.camera
    write_camera(tmp_path / "camera.npz", camera.calibration)
    write_image(tmp_path / "photo.png", picture)
    export_view(ours, "opencv", tmp_path / "camera.yaml")
    found = run("use-opencv.md", tmp_path, monkeypatch)
    np.testing.assert_allclose(found["cameraMatrix"], found["view"].matrix, rtol=1e-12)
    straight = Straightener(ours)(picture)
    inner = cv2.erode((straight > 0).astype(np.uint8), np.ones((5, 5))) > 0  # at the rim cv2.remap mixes black in
    difference = np.abs(found["straight"][..., 0].astype(int) - straight)[inner]
    assert np.quantile(difference, 0.99) <= 1  # of 255: the maps are the same, read back from text
    expected = found["view"].project(ours.to_rays(found["corners"][:, 0].astype(float)).directions)
    np.testing.assert_allclose(found["ideal"][:, 0], expected, atol=1e-6)


def test_ros(camera, picture, tmp_path, monkeypatch):
    write_camera(tmp_path / "camera.npz", camera.calibration)
    found = run("use-ros.md", tmp_path, monkeypatch)
    straight = Straightener(camera.calibration.camera)(picture)
    difference = np.abs(found["on_image"](picture).astype(int) - straight)
    assert np.quantile(difference, 0.99) <= 6  # of 255, at hard edges: fixed-point maps hold 1/32 px


def test_colmap(camera, tmp_path, monkeypatch):
    pytest.importorskip("pycolmap")
    write_camera(tmp_path / "camera.npz", camera.calibration)
    found = run("use-colmap.md", tmp_path, monkeypatch)
    turned = np.array([[0.1, 0.2, 1.0]]) @ found["view"].rotation
    np.testing.assert_allclose(found["pixels"], found["view"].project(turned), atol=1e-9)


def test_pytorch(camera, picture, tmp_path):
    """Run by the system's Python where torch is not installed in ours (Debian: python3-torch)."""
    python = next((p for p in (sys.executable, "/usr/bin/python3") if has_torch(p)), None)
    if python is None:
        pytest.skip("torch is not installed (Debian: python3-torch)")
    export_view(camera.calibration.camera, "npy", tmp_path / "map.npy")
    np.save(tmp_path / "in.npy", picture.astype(np.float32)[None, None])
    ending = "np.save('out.npy', straighten(torch.from_numpy(np.load('in.npy'))).numpy())\n"
    subprocess.run([python, "-c", python_of("use-pytorch.md") + ending], cwd=tmp_path, check=True)
    straight = Straightener(camera.calibration.camera)(picture).astype(float)
    difference = np.abs(np.clip(np.load(tmp_path / "out.npy")[0, 0], 0, 255) - straight)
    inner = cv2.erode((straight > 0).astype(np.uint8), np.ones((7, 7)), borderValue=0) > 0
    assert inner.mean() > 0.6
    assert np.quantile(difference[inner], 0.99) < 3.0  # of 255: OpenCV rounds to 1/32 px; half a pixel would give 40


def has_torch(python):
    command = [python, "-c", "import torch"]
    return Path(python).exists() and subprocess.run(command, capture_output=True).returncode == 0


def in_right(pose):
    """A board's pose before the right camera."""
    return Pose(SHIFT.rotation @ pose.rotation, SHIFT.apply(pose.translation[None])[0])
