"""Where another program's lens sees nothing, nothing of ours makes up a ray: every way from pixels and back says so."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pinholify import points
from pinholify.cli import main
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.io.export.base import export_view
from pinholify.io.images import write_image
from pinholify.io.importing import read_foreign
from pinholify.io.importing.adoption import WORST, adopt
from pinholify.modes import cropped
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from pinholify.refinement.comparison import compare

SIZE = (320, 240)
FOCAL, CENTRE = np.array([120.0, 121.0]), np.array([158.0, 121.0])
K = np.array([[FOCAL[0], 0.0, CENTRE[0]], [0.0, FOCAL[1], CENTRE[1]], [0.0, 0.0, 1.0]])
FOLDING = np.array([-0.1, -0.02, 0.0, 0.0])
FOLD = np.sqrt(2.0)
"""θ (1 − 0.1 θ² − 0.02 θ⁴) has its largest value where 1 − 0.3 θ² − 0.1 θ⁴ = 0."""

LARGEST = FOLD * (1.0 - 0.1 * FOLD**2 - 0.02 * FOLD**4)
XI, ALPHA = 0.2, 0.8
CHAIN = f"""cam0:
  camera_model: {{model}}
  intrinsics: [{{own}}{FOCAL[0]}, {FOCAL[1]}, {CENTRE[0]}, {CENTRE[1]}]
  distortion_model: {{lens}}
  distortion_coeffs: [{{distortion}}]
  resolution: [{SIZE[0]}, {SIZE[1]}]
"""
FISHEYE = CHAIN.format(model="pinhole", own="", lens="equi", distortion=", ".join(map(repr, FOLDING.tolist())))
DOUBLE_SPHERE = CHAIN.format(model="ds", own=f"{XI}, {ALPHA}, ", lens="none", distortion="")
PIXELS = np.random.default_rng(0).uniform(-0.5, np.array(SIZE) - 0.5, (40_000, 2))


def fisheye_truth(uv):
    """Rays by OpenCV of the pixels that the formula reaches before it turns back; the rest are nan."""
    reached = np.linalg.norm((uv - CENTRE) / FOCAL, axis=1) < LARGEST
    plane = cv2.fisheye.undistortPoints(uv[:, None], K, FOLDING)[:, 0]
    rays = np.column_stack([plane, np.ones(len(plane))])
    return np.where(reached[:, None], rays / np.linalg.norm(rays, axis=1, keepdims=True), np.nan)


def double_sphere_truth(uv):
    """The closed form of Usenko, Demmel & Cremers 2018, equations 46 to 52; nan where its root has no number."""
    m = (uv - CENTRE) / FOCAL
    square = (m**2).sum(axis=1)
    with np.errstate(invalid="ignore"):
        z = (1 - ALPHA**2 * square) / (ALPHA * np.sqrt(1 - (2 * ALPHA - 1) * square) + 1 - ALPHA)
        scale = (z * XI + np.sqrt(z**2 + (1 - XI**2) * square)) / (z**2 + square)
    rays = scale[:, None] * np.column_stack([m, z])
    rays[:, 2] -= XI
    return rays


def fisheye_image(rays):
    """Pixels by OpenCV."""
    return cv2.fisheye.projectPoints((rays / rays[:, 2:])[:, None], np.zeros(3), np.zeros(3), K, FOLDING)[0][:, 0]


def double_sphere_image(rays):
    """Equations 40 to 43 of that paper."""
    z = rays[:, 2] + XI * np.linalg.norm(rays, axis=1)
    depth = ALPHA * np.hypot(np.hypot(rays[:, 0], rays[:, 1]), z) + (1 - ALPHA) * z
    return FOCAL * rays[:, :2] / depth[:, None] + CENTRE


LENSES = {
    "fisheye": (FISHEYE, fisheye_truth, fisheye_image),
    "double sphere": (DOUBLE_SPHERE, double_sphere_truth, double_sphere_image),
}


@pytest.fixture(scope="module", params=LENSES)
def lens(request, tmp_path_factory):
    """A camera file of a lens that ends inside its image; its true rays of pixels, and pixels of rays."""
    text, truth, image = LENSES[request.param]
    folder = tmp_path_factory.mktemp("lens")
    (folder / "camchain.yaml").write_text(text)
    write_camera(folder / "camera.npz", adopt(read_foreign(folder / "camchain.yaml")).calibration)
    return folder / "camera.npz", truth, image


@pytest.fixture
def camera(lens):
    return read_camera(lens[0]).camera


def test_rays_are_the_lens_or_nan(lens, camera):
    truth = lens[1](PIXELS)
    seen = camera.to_rays(PIXELS)
    known = np.isfinite(seen.directions).all(axis=1)
    exists = np.isfinite(truth).all(axis=1)
    assert 0.4 < exists.mean() < 0.95
    assert not (known & ~exists).any()
    assert known[exists].mean() > 0.95  # near its end the lens bends without bound
    angles = np.linalg.norm(np.cross(seen.directions[known], truth[known]), axis=1)
    assert np.quantile(angles, 0.95) < 1e-4
    np.testing.assert_array_equal(np.isfinite(seen.std_px), known)
    np.testing.assert_array_equal(camera.inside(PIXELS), known)
    np.testing.assert_array_equal(np.isfinite(camera.to_virtual(PIXELS).points).all(axis=1) <= known, True)


def test_the_largest_error_that_is_told_holds_everywhere(lens):
    calibration = read_camera(lens[0])
    rays = calibration.camera.to_rays(PIXELS).directions
    known = np.isfinite(rays).all(axis=1)
    told = calibration.details["fit_largest_px"]
    assert np.linalg.norm(lens[2](rays[known]) - PIXELS[known], axis=1).max() <= told < WORST


def test_points_like_opencvs_are_nan_too(lens, camera):
    """A few, asked of the map, and many, looked up in tables."""
    exists = np.isfinite(lens[1](PIXELS)).all(axis=1)
    for some in (slice(1000), slice(None)):
        uv = PIXELS[some]
        for answer in (points.pixel_rays(uv, camera), points.undistort_points(uv, camera)):
            assert not np.isfinite(answer[~exists[some]]).any()
    assert np.isfinite(points.pixel_rays(PIXELS, camera)).all(axis=1).sum() > 0.95 * exists.sum()


def test_what_is_seen_is_seen_where_the_lens_shows_it(camera):
    """No direction beyond the lens's end comes back as a pixel, and those of the image as theirs."""
    rays = camera.to_rays(PIXELS).directions
    known = np.isfinite(rays).all(axis=1)
    assert np.abs(camera.project(rays[known]) - PIXELS[known]).max() < 1e-5
    around = np.random.default_rng(1).normal(size=(20_000, 3))
    uv = camera.project(around)
    back = camera.to_rays(uv[np.isfinite(uv).all(axis=1)]).directions
    ahead = around[np.isfinite(uv).all(axis=1)]
    assert np.abs(back - ahead / np.linalg.norm(ahead, axis=1, keepdims=True)).max() < 1e-6


def test_map_says_nan(lens, tmp_path, capsys):
    (tmp_path / "points.csv").write_text(f"u,v\n2,2\n{CENTRE[0]},{CENTRE[1]}\n317,237\n-4,120\n")
    assert main(["map", str(lens[0]), "--to", "rays", str(tmp_path / "points.csv")]) == 0
    out, err = capsys.readouterr()
    rows = out.splitlines()[1:]
    assert [row.startswith("nan") for row in rows] == [True, False, True, True]
    assert "3 of 4 points have no result" in err


@pytest.mark.parametrize("max_std", [None, 1.0])
def test_pictures_show_nothing_there(lens, camera, max_std):
    """White where the lens sees, black where it does not: so is the picture, at every pixel that looks there."""
    height, width = SIZE[1], SIZE[0]
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2).astype(float)
    seen = np.isfinite(lens[1](pixels)).all(axis=1).reshape(height, width)
    picture = Straightener(camera, ViewOptions(max_std=max_std))(np.where(seen, 255, 100).astype(np.uint8))
    inner = cv2.erode(picture, np.ones((5, 5), np.uint8))  # at the end cubic interpolation mixes what lies beyond
    assert inner[inner > 0].min() > 240
    assert (picture > 240).mean() > 0.3


def test_maps_and_exports_leave_it_out(lens, camera, tmp_path):
    straightener = Straightener(camera)
    rectification = rectification_map(camera, straightener.view)
    uv = rectification.uv[rectification.valid].astype(float)
    inside = np.clip(uv, 0, np.array(SIZE) - 1)
    assert np.isfinite(lens[1](inside)).all()
    export_view(camera, "npy", tmp_path / "maps.npy")
    np.testing.assert_array_equal(np.isfinite(np.load(tmp_path / "maps.npy")).all(axis=2), rectification.valid)


def test_another_mode_of_the_sensor_is_as_blind(camera):
    corner = cropped(camera, 0, 0, (160, 120))
    assert np.isnan(corner.to_rays(np.array([[2.0, 2.0]])).directions).all()
    np.testing.assert_allclose(
        corner.to_rays(np.array([[150.0, 110.0]])).directions, camera.to_rays(np.array([[150.0, 110.0]])).directions
    )


def test_it_can_be_compared(camera, lens, tmp_path, capsys):
    result = compare(camera, camera)
    assert result.rms() == pytest.approx(0.0, abs=1e-9)
    assert result.rms(everywhere=True) == pytest.approx(0.0, abs=1e-9)
    assert main(["compare", str(lens[0]), str(lens[0]), "-o", str(tmp_path / "difference.png")]) == 0
    assert "nan" not in capsys.readouterr().out


def test_its_pictures_are_made_by_the_command(lens, tmp_path):
    write_image(tmp_path / "a.png", np.full((SIZE[1], SIZE[0]), 200, np.uint8))
    assert main(["undistort", str(lens[0]), str(tmp_path / "a.png"), "-o", str(tmp_path / "out")]) == 0
    picture = cv2.imread(str(tmp_path / "out" / "a.png"), cv2.IMREAD_UNCHANGED)
    assert picture.max() == 200
