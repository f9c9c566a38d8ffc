"""A camera that is given starts the joint refinement: it helps where no scan of lenses does, and never hurts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify import pipeline
from pinholify.arrays import Floats
from pinholify.board import lattice
from pinholify.camera import VirtualCamera
from pinholify.charts import AngleChart
from pinholify.corners import Corners, CornerSet
from pinholify.errors import DegenerateError, InputError
from pinholify.geometry import convex_hull
from pinholify.io.importing.adoption import adopt
from pinholify.io.importing.base import ForeignCamera
from pinholify.modes import cropped
from pinholify.refinement import JointResult, candidates, refine
from pinholify.refinement.observations import image_frame, lattice_middle, observations
from pinholify.refinement.start import board_misfit, given_lens
from pinholify.refinement.trends import Angles, LensTrend, Plane
from pinholify.refinement.trends.fitting import fit_trend
from pinholify.simulation.lenses import Fisheye, Lens
from pinholify.simulation.lenses.base import LensRays
from pinholify.simulation.views import board_poses, true_corners

from .conftest import BOARD, FOCAL, SIZE, Project, Scene, fisheye, make_scene

FRAME = image_frame(SIZE, False)


def camera_of(project: Project, size: tuple[int, int] = SIZE) -> VirtualCamera:
    """A lens as another program's camera, imported."""
    centre = (np.array(size) - 1.0) / 2.0
    return adopt(ForeignCamera("theirs", "opencv", "any", project, np.full(2, FOCAL), centre, size)).calibration.camera


def pinhole_of(focal: float, hand: int = 1) -> Project:
    """No distortion; a reflection where ``hand`` is -1."""

    def project(xyz: Floats) -> Floats:
        with np.errstate(divide="ignore", invalid="ignore"):
            xy = focal * xyz[:, :2] * [hand, 1] / xyz[:, 2:]
        return np.where(xyz[:, 2:] > 0, xy, np.nan) + (np.array(SIZE) - 1.0) / 2.0

    return project


def equidistant_of(focal: float) -> Project:
    """A fisheye without distortion."""
    return Fisheye(SIZE, focal).project


# --- where it helps ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Window:
    """What a sensor shows that reads a part of the image of ``lens`` only."""

    lens: Lens
    left: int
    top: int
    size: tuple[int, int]
    central = True

    def project(self, points: Floats) -> Floats:
        return np.asarray(self.lens.project(points) - [self.left, self.top])

    def unproject(self, uv: Floats) -> LensRays:
        return self.lens.unproject(uv + np.array([self.left, self.top]))


WHOLE = Fisheye((3840, 2160), 1000.0, (0.02, -0.008, 0.001, 0.0))
WINDOW = Window(WHOLE, 2800, 1300, (1000, 800))  # the lens's axis stands far outside


def seen(lens: Lens, boards: list[Floats], rng: np.random.Generator) -> CornerSet:
    noisy = [uv + rng.normal(0, 0.1, uv.shape) for uv in boards]
    views = [Corners(f"view{i:02d}", np.arange(len(uv)), uv) for i, uv in enumerate(noisy)]
    return CornerSet(BOARD, (lens.size[0], lens.size[1]), tuple(views))


def oblique(lens: Lens, count: int, seed: int) -> CornerSet:
    """Boards turned away from the camera by 45 to 65 degrees about both axes, smaller than the image."""
    rng, boards = np.random.default_rng(seed), []
    middle = lattice(BOARD).mean(axis=0)
    while len(boards) < count:
        ray = lens.unproject(rng.uniform(0.1, 0.9, (1, 2)) * lens.size).directions[0]
        angles = [rng.normal(0, 20), *rng.choice([-1, 1], 2) * rng.uniform(45, 65, 2)]
        facing = Rotation.align_vectors([ray], [[0.0, 0.0, 1.0]])[0]
        rotation = (facing * Rotation.from_euler("zyx", angles, degrees=True)).as_matrix()[:, :2]
        uv = lens.project((lattice(BOARD) - middle) @ rotation.T + rng.uniform(9, 18) * ray)
        if ((uv > 2) & (uv < np.array(lens.size) - 3)).all():
            boards.append(uv)
    return seen(lens, boards, rng)


def error_px(lens: Lens, camera: VirtualCamera) -> float:
    """RMS over the domain of what ``camera`` says wrongly of ``lens``, the best rotation removed."""
    u, v = np.meshgrid(*(np.linspace(0, n - 1, 17) for n in lens.size))
    uv = np.column_stack([u.ravel(), v.ravel()])
    uv = uv[camera.domain.hull.contains(uv)]
    rays = camera.to_rays(uv).directions
    turn = Rotation.align_vectors(lens.unproject(uv).directions, rays)[0]
    return float(np.sqrt((np.linalg.norm(lens.project(turn.apply(rays)) - uv, axis=1) ** 2).mean()))


@pytest.fixture(scope="module")
def last_month() -> VirtualCamera:
    """The whole sensor calibrated from a dozen ordinary boards, in the window's mode."""
    poses = board_poses((WHOLE,), BOARD, 12, seed=0)
    boards = [true_corners(WHOLE, BOARD, pose) for pose in poses]
    camera = pipeline.calibrate(seen(WHOLE, boards, np.random.default_rng(0))).camera
    return cropped(camera, WINDOW.left, WINDOW.top, WINDOW.size)


def errors_px(start: VirtualCamera, seed: int) -> tuple[float, float]:
    """Without the start, infinite where that gives no camera, and with it, from five oblique boards in the window."""
    corners = oblique(WINDOW, 5, seed)
    led = pipeline.calibrate(corners, start=start)
    assert led.details["start_fits"] is True
    try:
        without = pipeline.calibrate(corners)
    except DegenerateError:
        return np.inf, error_px(WINDOW, led.camera)
    assert without.details["start_fits"] is None
    return error_px(WINDOW, without.camera), error_px(WINDOW, led.camera)


@pytest.mark.parametrize("seed", [6, 8])
def test_oblique_boards_in_a_part_of_a_fisheyes_image(last_month: VirtualCamera, seed: int) -> None:
    """A scan for an axis in the image's middle ends at another camera, of about the same noise."""
    without, led = errors_px(last_month, seed)
    assert led < 0.3
    assert without > 3.0 * led


@pytest.mark.slow
def test_oblique_boards_in_a_part_of_a_fisheyes_image_as_a_rule(last_month: VirtualCamera) -> None:
    without, led = np.transpose([errors_px(last_month, seed) for seed in range(12)])
    assert np.median(led) < 0.2
    assert np.median(without) > 2.0 * np.median(led)
    assert (led < without + 0.05).all()  # a few find the camera as well without


# --- and does not hurt -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def results(scenes: dict[str, Scene]) -> dict[str, JointResult]:
    return {name: refine(scene.corners, reference="view00") for name, scene in scenes.items()}


def difference_px(first: VirtualCamera, second: VirtualCamera) -> float:
    """The largest over the domain; both are in the frame of the same board."""
    u, v = np.meshgrid(*(np.linspace(0, n - 1, 17) for n in SIZE))
    uv = np.column_stack([u.ravel(), v.ravel()])
    uv = uv[first.domain.hull.contains(uv)]
    return float(np.abs(second.project(first.to_rays(uv).directions) - uv).max())


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("pinhole", pinhole_of(1.1 * FOCAL)),
        ("wavy", pinhole_of(0.9 * FOCAL)),
        ("fisheye", equidistant_of(1.1 * 0.75 * FOCAL)),
        ("fisheye", equidistant_of(0.9 * 0.75 * FOCAL)),
    ],
)
def test_a_focal_length_a_tenth_off_and_no_distortion_change_nothing(
    scenes: dict[str, Scene], results: dict[str, JointResult], name: str, start: Project
) -> None:
    led = refine(scenes[name].corners, reference="view00", start=camera_of(start))
    assert led.start_fits is True
    assert led.trend == results[name].trend
    assert difference_px(results[name].camera, led.camera) < 1e-6


@pytest.mark.parametrize("name", ["pinhole", "fisheye"])
def test_another_lens_altogether_changes_nothing(
    scenes: dict[str, Scene], results: dict[str, JointResult], name: str
) -> None:
    led = refine(scenes[name].corners, reference="view00", start=camera_of(pinhole_of(20.0 * FOCAL)))
    assert difference_px(results[name].camera, led.camera) < 1e-6


def test_a_start_that_explains_nothing_is_left_aside(
    scenes: dict[str, Scene], results: dict[str, JointResult]
) -> None:
    led = refine(scenes["pinhole"].corners, reference="view00", start=camera_of(pinhole_of(FOCAL, -1)))
    assert led.start_fits is False
    assert difference_px(results["pinhole"].camera, led.camera) < 1e-6


def test_a_start_of_another_size_is_refused() -> None:
    corners = make_scene("pinhole", views=4).corners
    small = camera_of(Fisheye((400, 300), 100.0).project, (400, 300))
    refusal = "images of 400x300, but these images are 800x600: make the camera of this mode"
    with pytest.raises(InputError, match=refusal):
        pipeline.calibrate(corners, start=small)


def test_what_is_no_camera_is_refused() -> None:
    with pytest.raises(InputError, match="a str was given where a VirtualCamera is needed"):
        pipeline.calibrate(make_scene("pinhole", views=4).corners, start="camera.npz")  # type: ignore[arg-type]


def test_a_start_makes_the_method_joint_and_the_papers_takes_none() -> None:
    corners, start = make_scene("pinhole", views=3).corners, camera_of(pinhole_of(FOCAL))
    assert pipeline.calibrate(corners, start=start).method == "joint"
    with pytest.raises(InputError, match="choose the method 'joint', or give no start"):
        pipeline.calibrate(corners, start=start, method="one-image")


# --- its parts ---------------------------------------------------------------------------------------------------


def test_the_lens_given_puts_boards_where_they_stand_beyond_ninety_degrees_too() -> None:
    lens = Fisheye(SIZE, 200.0)  # 143 degrees from the axis in the corners
    ahead = np.column_stack([lattice(BOARD) - lattice_middle(BOARD), np.full(54, 9.0)])
    poses = [Rotation.from_rotvec([0.0, np.deg2rad(angle), 0.0]) for angle in (0, 60, 85, 100)]
    corners = seen(lens, [lens.project(turn.apply(ahead)) for turn in poses], np.random.default_rng(0))
    given = given_lens(camera_of(lens.project), FRAME, SIZE)
    everything = observations(corners.views, BOARD, FRAME)
    assert (given.directions(everything.image)[:, 2] < 0).any()
    misfit, rotations, translations = board_misfit(given, everything)
    assert (misfit * FRAME.scale < 0.2).all()
    for turn, rotation, translation in zip(poses, rotations, translations, strict=True):
        np.testing.assert_allclose(rotation, turn.as_matrix(), atol=0.02)
        np.testing.assert_allclose(translation, turn.apply([0.0, 0.0, 9.0]), atol=0.1)


def test_how_long_a_radian_is() -> None:
    given = given_lens(camera_of(equidistant_of(300.0)), FRAME, SIZE)
    middle = FRAME.normalise((np.array([SIZE]) - 1.0) / 2.0)
    np.testing.assert_allclose(given.radian(middle) * FRAME.scale, 300.0, rtol=1e-3)
    pinhole = given_lens(camera_of(pinhole_of(300.0)), FRAME, SIZE)
    along, across = 300.0 * (1.0 + 0.75**2), 300.0 * np.sqrt(1.0 + 0.75**2)
    place = FRAME.normalise(np.array([[399.5 + 0.75 * 300.0, 299.5]]))
    np.testing.assert_allclose(pinhole.radian(place) * FRAME.scale, np.sqrt(along * across), rtol=1e-3)


def test_a_camera_of_one_image_is_levelled(scenes: dict[str, Scene]) -> None:
    """Its frame is that of a board that stands askew; trends have their axis in the image's middle, and no roll."""
    one = pipeline.calibrate(scenes["pinhole"].corners, method="one-image", trend="lens:1").camera
    assert not isinstance(one.chart, AngleChart)
    given = given_lens(one, FRAME, SIZE)
    uv = np.array([[401.0, 297.0], [441.0, 297.0], [401.0, 337.0]])
    directions = given.directions(FRAME.normalise(uv))
    np.testing.assert_allclose(directions[:, :2] / directions[:, 2:] * FOCAL, uv - [399.5, 299.5], atol=2.5)
    assert refine(scenes["pinhole"].corners, reference="view00", start=one).start_fits is True


@pytest.mark.parametrize("angle", [90, 180])
def test_a_camera_whose_frame_is_rolled_is_put_upright(
    scenes: dict[str, Scene], results: dict[str, JointResult], angle: float
) -> None:
    """A lens seen upside down would be one of negative scale, which folds."""
    roll = Rotation.from_euler("z", angle, degrees=True)
    start = camera_of(lambda xyz: pinhole_of(FOCAL)(roll.apply(xyz)))
    given = given_lens(start, FRAME, SIZE)
    np.testing.assert_allclose(given.turn, roll.as_matrix(), atol=1e-6)
    led = refine(scenes["pinhole"].corners, reference="view00", start=start)
    assert led.start_fits is True
    assert difference_px(results["pinhole"].camera, led.camera) < 1e-6


def test_corners_outside_the_starts_domain_are_no_hindrance(scenes: dict[str, Scene]) -> None:
    """Nowhere is a camera believed that saw only a corner of the image, yet it knows roughly what is beside."""
    camera = camera_of(fisheye)
    blind = replace(camera, domain=replace(camera.domain, hull=convex_hull(np.array([[0.0, 0], [30, 0], [0, 30]]))))
    assert refine(scenes["fisheye"].corners, reference="view00", start=blind).start_fits is True


def test_a_start_that_is_known_in_the_middle_alone(scenes: dict[str, Scene]) -> None:
    """A polynomial that folds says nonsense of most of a fisheye's image; where it does not, it is good enough."""

    def folding(xyz: Floats) -> Floats:
        xy = xyz[:, :2] / xyz[:, 2:]
        bent = 300.0 * xy * (1.0 - 0.3 * (xy**2).sum(axis=1, keepdims=True))
        return np.where(xyz[:, 2:] > 0, bent, np.nan) + (np.array(SIZE) - 1.0) / 2.0

    start = camera_of(folding)
    assert start.domain.hull.area < 0.3 * np.prod(SIZE)
    assert refine(scenes["fisheye"].corners, reference="view00", start=start).start_fits is True


@pytest.mark.parametrize("distorting", [True, False])
@pytest.mark.parametrize("chart", [Angles(), Plane()], ids=["angles", "plane"])
def test_a_lens_with_its_axis_outside_the_image_is_fitted(chart: Angles | Plane, distorting: bool) -> None:
    truth = LensTrend(chart, distorting, 1, anisotropic=False, tilted=False, elliptic=False, tangent=False)
    beta = np.array([1.6 if distorting else 0.6, -1.4, -0.8, -0.01])
    w = np.random.default_rng(0).uniform(-1, 1, (300, 2)) * FRAME.half_size
    rays = chart.directions(truth.ray(beta, w))
    trend = replace(truth, anisotropic=True, elliptic=True)
    found = fit_trend(trend, w, rays)
    assert found is not None
    np.testing.assert_allclose(trend.image(found, truth.ray(beta, w), w), w, atol=1e-3)


def test_a_trend_that_cannot_be_linearised_is_no_candidate(
    scenes: dict[str, Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(*_: object) -> None:
        raise np.linalg.LinAlgError("Matrix is not positive definite")

    solve, refused = candidates.solve, []

    def first_refused(*words: object) -> object:
        with monkeypatch.context() as patch:
            if not refused:
                patch.setattr(candidates, "linearise_with", singular)
            refused.append(solve(*words))  # type: ignore[arg-type]
            return refused[-1]

    monkeypatch.setattr(candidates, "solve", first_refused)
    assert refine(scenes["fisheye"].corners, reference="view00").noise_px == pytest.approx(0.1, rel=0.06)
    assert refused[0] is None
    assert len(refused) > 1
