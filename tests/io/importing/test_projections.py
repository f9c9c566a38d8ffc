"""Other programs' lens models against these programs themselves: to 1e-9 px, where both see the point."""

import cv2
import numpy as np
import pytest

from mrcal_oracle import mrcal
from pinholify.io.importing import projections, read_foreign

CORE = np.array([500.0, 510.0, 320.0, 240.0])
MATRIX = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
RNG = np.random.default_rng(0)
AROUND = RNG.normal(size=(300, 3))
FRONT = AROUND * [1.0, 1.0, 0.0] + [0.0, 0.0, 1.0] * (np.abs(AROUND[:, 2:]) + 0.4)
BENT = RNG.normal(0, 0.02, (11 * 16 * 2)).tolist()

MRCAL = {
    "PINHOLE": [],
    "STEREOGRAPHIC": [],
    "LONLAT": [],
    "LATLON": [],
    "OPENCV4": [-0.2, 0.05, 0.001, -0.002],
    "OPENCV5": [-0.2, 0.05, 0.001, -0.002, 0.01],
    "OPENCV8": [0.5, 0.1, 0.001, -0.002, 0.01, 0.6, 0.2, 0.02],
    "OPENCV12": [0.5, 0.1, 0.001, -0.002, 0.01, 0.6, 0.2, 0.02, 0.001, -0.002, 0.003, 0.001],
    "CAHVOR": [0.02, -0.03, 0.01, -0.1, 0.02],
    "SPLINED_STEREOGRAPHIC_order=3_Nx=16_Ny=11_fov_x_deg=120": BENT,
    "SPLINED_STEREOGRAPHIC_order=2_Nx=16_Ny=11_fov_x_deg=120": BENT,
}
BEHIND = ("STEREOGRAPHIC", "LONLAT", "LATLON")
"""Models that see points behind the camera. (A splined one does too, but its points fly off far beyond its knots.)"""


@pytest.mark.parametrize("model", MRCAL)
def test_mrcal_projects_alike(model, tmp_path):
    path = tmp_path / "a.cameramodel"
    path.write_text(
        "# a comment\n"
        + repr({"lensmodel": f"LENSMODEL_{model}", "intrinsics": [*CORE.tolist(), *MRCAL[model]],
                "extrinsics": [0.0] * 6, "imagersize": [640, 480]})
    )
    points = AROUND if model in BEHIND else FRONT
    camera = read_foreign(path)
    assert (camera.program, camera.model, camera.image_size) == ("mrcal", f"LENSMODEL_{model}", (640, 480))
    ours, theirs = camera.project(points), mrcal(path, points)[0]
    known = np.isfinite(ours).all(axis=1)
    assert known.mean() > 0.95  # CAHVOR of a point that its own polynomial throws behind the camera is nan
    assert np.abs((ours - theirs)[known] / np.maximum(1.0, np.abs(theirs[known]))).max() < 1e-9


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_opencv_projects_alike(count):
    coefficients = RNG.normal(0, 0.01, count)
    theirs = cv2.projectPoints(FRONT, np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    np.testing.assert_allclose(projections.brown(CORE, coefficients)(FRONT), theirs, atol=1e-9)
    assert np.isnan(projections.brown(CORE, coefficients)(-FRONT)).all()


def test_opencvs_fisheye_projects_alike():
    coefficients = np.array([0.02, -0.01, 0.003, -0.0005])
    theirs = cv2.fisheye.projectPoints(FRONT[:, None], np.zeros(3), np.zeros(3), MATRIX, coefficients)[0][:, 0]
    np.testing.assert_allclose(projections.fisheye(CORE, coefficients)(FRONT), theirs, atol=1e-9)


def colmap(model, parameters):
    pycolmap = pytest.importorskip("pycolmap")
    if not hasattr(pycolmap.CameraModelId, model):
        pytest.skip(f"this pycolmap has no {model}")
    camera = pycolmap.Camera(model=model, width=640, height=480, params=parameters)
    return np.array(camera.img_from_cam(FRONT))


def test_colmaps_eucm_and_fov_project_alike():
    eucm = projections.extended_unified(CORE, 0.6, 1.1)
    np.testing.assert_allclose(eucm(FRONT), colmap("EUCM", [*CORE, 0.6, 1.1]), atol=1e-9)
    fov = projections.field_of_view(CORE, 0.9)
    np.testing.assert_allclose(fov(FRONT), colmap("FOV", [*CORE, 0.9]), atol=1e-9)


def test_kalibrs_sphere_models_agree_where_they_are_the_same():
    """The double sphere with ξ = 0 is eucm with β = 1; eucm with β = 1 is omni with ξ = α/(1 − α), f scaled alike."""
    sphere, alpha = projections.double_sphere(CORE, 0.0, 0.6), 0.6
    np.testing.assert_allclose(sphere(FRONT), projections.extended_unified(CORE, alpha, 1.0)(FRONT), atol=1e-9)
    scaled = np.concatenate([CORE[:2] / (1.0 - alpha), CORE[2:]])
    omni = projections.unified(scaled, alpha / (1.0 - alpha), np.zeros(4))
    np.testing.assert_allclose(sphere(FRONT), omni(FRONT), atol=1e-9)


def test_the_double_sphere_by_its_construction():
    """A point goes to a sphere, to a second one moved by ξ, and is seen from α/(1 − α) behind that one's centre."""
    xi, alpha = -0.2, 0.55
    first = FRONT / np.linalg.norm(FRONT, axis=1, keepdims=True) + [0, 0, xi]
    second = first / np.linalg.norm(first, axis=1, keepdims=True) + [0, 0, alpha / (1.0 - alpha)]
    expected = second[:, :2] / second[:, 2:] / (1.0 - alpha) * CORE[:2] + CORE[2:]
    np.testing.assert_allclose(projections.double_sphere(CORE, xi, alpha)(FRONT), expected, atol=1e-9)


def test_the_unified_camera_with_distortion_is_opencvs_beyond_the_sphere():
    xi, radtan = 0.8, np.array([-0.1, 0.02, 0.001, -0.0005])
    moved = FRONT / np.linalg.norm(FRONT, axis=1, keepdims=True) + [0, 0, xi]
    theirs = cv2.projectPoints(moved, np.zeros(3), np.zeros(3), MATRIX, radtan)[0][:, 0]
    np.testing.assert_allclose(projections.unified(CORE, xi, radtan)(FRONT), theirs, atol=1e-9)
