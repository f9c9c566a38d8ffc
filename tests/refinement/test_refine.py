"""The whole refinement on simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pinholify import pipeline
from pinholify.arrays import Floats
from pinholify.board import Checkerboard, lattice
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError
from pinholify.refinement import JointResult, refine
from pinholify.simulation import lenses
from pinholify.simulation.views import board_poses, true_corners

from .conftest import BOARD, LENSES, SIZE, Scene, cockled, make_scene, ray_errors_px, true_intrinsics

BOUND = {"pinhole": 0.1, "fisheye": 0.15, "wavy": 0.3}  # px rms inside the hull, at 0.1 px of noise a corner


@pytest.fixture(scope="module")
def results(scenes: dict[str, Scene]) -> dict[str, JointResult]:
    return {name: refine(scene.corners, reference="view00") for name, scene in scenes.items()}


def grid(result: JointResult) -> np.ndarray:
    u, v = np.meshgrid(np.linspace(0, SIZE[0] - 1, 17), np.linspace(0, SIZE[1] - 1, 13))
    uv = np.column_stack([u.ravel(), v.ravel()])
    return uv[result.camera.domain.hull.contains(uv)]


def covered_error(scene: Scene, result: JointResult) -> float:
    uv = grid(result)
    errors = ray_errors_px(scene, uv, result.camera.to_rays(uv).directions)
    return float(np.sqrt((errors**2).mean()))


@pytest.mark.parametrize("name", LENSES)
def test_rays_and_noise(name: str, scenes: dict[str, Scene], results: dict[str, JointResult]) -> None:
    assert covered_error(scenes[name], results[name]) < BOUND[name]
    assert results[name].noise_px == pytest.approx(0.1, rel=0.06)
    assert bool(results[name].kernel_px) == (name == "wavy")


@pytest.mark.parametrize("name", LENSES)
def test_intrinsics_and_poses(name: str, scenes: dict[str, Scene], results: dict[str, JointResult]) -> None:
    scene, result = scenes[name], results[name]
    k = result.camera.intrinsics
    assert (np.abs([k.f, k.uc, k.vc] - true_intrinsics(scene)) < 4.0 * result.intrinsics_std).all()
    reference = result.poses["view00"]
    np.testing.assert_allclose(reference.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(reference.translation, [-k.uc, -k.vc, k.f], atol=1e-10)
    expected = scene.rotations[0].T @ scene.rotations[5]
    np.testing.assert_allclose(result.poses["view05"].rotation, expected, atol=5e-3)


@pytest.mark.parametrize("name", LENSES)
def test_the_map_and_its_inverse(name: str, results: dict[str, JointResult]) -> None:
    camera = results[name].camera
    uv = grid(results[name])
    np.testing.assert_allclose(camera.project(camera.to_rays(uv).directions), uv, atol=1e-6)
    for i, h in enumerate(1e-3 * np.eye(2)):
        numeric = (camera.plane_map.value(uv + h) - camera.plane_map.value(uv - h)) / 2e-3
        np.testing.assert_allclose(camera.plane_map.jacobian(uv)[:, :, i], numeric, rtol=1e-5, atol=1e-8)


def test_a_lens_is_inverted_without_a_search_and_a_polynomial_by_one(
    scenes: dict[str, Scene], results: dict[str, JointResult]
) -> None:
    lens = results["wavy"].camera.plane_map
    uv = grid(results["wavy"])
    np.testing.assert_allclose(lens.inverse(lens.value(uv), _unasked), uv, atol=1e-6)
    polynomial = refine(scenes["wavy"].corners, reference="view00", trend="polynomial:3").camera
    np.testing.assert_allclose(polynomial.project(polynomial.to_rays(uv).directions), uv, atol=1e-6)


def _unasked(_: Floats) -> tuple[Floats, float]:
    raise AssertionError("what is near was asked for")


def virtual_features(camera: VirtualCamera, uv: np.ndarray) -> np.ndarray:
    """∂(virtual point)/∂(unknowns of the map's root) (n, 2, D + 6): by the ray, and by K, which share errors."""
    directions = camera.to_rays(uv).directions
    by_ray = camera.virtual_jacobian(uv) @ np.linalg.inv(camera.plane_map.jacobian(uv))
    by_k = camera.intrinsics.parameter_jacobian(directions)
    return by_ray @ camera.plane_map.features(uv) + by_k @ camera.plane_map.intrinsics_features()


@pytest.mark.parametrize("name", ["pinhole", "wavy"])
def test_features_of_the_covariance(name: str, results: dict[str, JointResult]) -> None:
    """∂(ray, K, virtual point)/∂unknowns by moving each unknown of the map."""
    plane_map = results[name].camera.plane_map
    uv = grid(results[name])[::5]
    m, p = 2 * len(plane_map.basis), len(plane_map.beta)
    rng, h = np.random.default_rng(0), 1e-6

    def moved(step: np.ndarray):
        return replace(
            plane_map,
            weights=plane_map.weights + step[:m].reshape(2, -1).T,
            beta=plane_map.beta + step[m : m + p],
            rotation=Rotation.from_rotvec(step[-6:-3]).as_matrix() @ plane_map.rotation,
            translation=plane_map.translation + step[-3:],
        )

    from pinholify.charts import directions_to_angles
    from pinholify.refinement.result import intrinsics_of

    def seen(one) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        from pinholify.charts import angles_to_directions

        k = intrinsics_of(one)
        directions = angles_to_directions(one.value(uv)) @ one.rotation
        back = directions_to_angles(directions @ plane_map.rotation.T)
        return back, np.array([k.f, k.uc, k.vc]), k.project(directions)

    step = rng.normal(size=m + p + 6)
    step[:m] *= 1e-2
    ahead, behind = seen(moved(h * step)), seen(moved(-h * step))
    expected = (plane_map.features(uv), plane_map.intrinsics_features(), virtual_features(results[name].camera, uv))
    for a, b, feature in zip(ahead, behind, expected, strict=True):
        np.testing.assert_allclose(feature @ step, (a - b) / (2 * h), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["pinhole", "wavy"])
def test_covariances_are_the_features_times_a_root(name: str, results: dict[str, JointResult]) -> None:
    camera, plane_map = results[name].camera, results[name].camera.plane_map
    uv = grid(results[name])[::5]
    turned = np.concatenate([plane_map.root[:-6], plane_map.turn_root, np.zeros_like(plane_map.turn_root)])
    for found, features, root in (
        (plane_map.covariance(uv), plane_map.features(uv), plane_map.root),
        (plane_map.covariance_up_to_turn(uv), plane_map.features(uv), turned),
        (camera.to_virtual(uv).covariance, virtual_features(camera, uv), plane_map.root),
    ):
        half = features @ root
        expected = half @ half.transpose(0, 2, 1)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_a_decentred_lens_is_known_as_such() -> None:
    """Brown's model with two radial terms and decentring is found among all the others."""
    scene = make_scene("decentred", views=20)
    result = refine(scene.corners, reference="view00")
    assert result.trend == "plane-d:2+p"
    assert not result.kernel_px
    assert covered_error(scene, result) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_a_pinhole_needs_no_law_of_distortion(seed: int) -> None:
    """Its trend is solved for itself: beside a law that has nothing to do, its evidence came out too low."""
    assert refine(make_scene("pinhole", views=24, seed=seed).corners, reference="view00").trend == "plane:0"


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_bumps_of_six_pixels_are_followed(seed: int) -> None:
    """What the linearised problem promises for a strong process may not hold; then other trends are looked at."""
    lens, board = lenses.LENSES["windscreen"], Checkerboard(12, 9)
    rng = np.random.default_rng(seed)
    views = [true_corners(lens, board, pose) for pose in board_poses([lens], board, 24, seed=seed)]
    corners = tuple(Corners(f"{i}", np.arange(108), uv + rng.normal(0, 0.1, uv.shape)) for i, uv in enumerate(views))
    result = refine(CornerSet(board, lens.size, corners), reference="0")
    assert result.noise_px == pytest.approx(0.1, rel=0.05)


def test_the_map_is_the_same_from_the_smallest_and_most_oblique_reference(
    scenes: dict[str, Scene], results: dict[str, JointResult]
) -> None:
    scene = scenes["fisheye"]
    spans = {view.name: np.linalg.det(np.cov(view.uv.T)) for view in scene.corners.views}
    result = refine(scene.corners, reference=min(spans, key=lambda name: spans[name]))
    assert result.log_evidence == pytest.approx(results["fisheye"].log_evidence, abs=1e-9)
    uv = grid(result)
    one, two = (each.camera.to_rays(uv).directions for each in (result, results["fisheye"]))
    np.testing.assert_allclose(one @ one.T, two @ two.T, atol=1e-12)  # but for a rotation


def test_many_boards_of_ordinary_size_are_taken_whole(
    scenes: dict[str, Scene], results: dict[str, JointResult], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "MAX_JOINT_CORNERS", 1)
    camera = pipeline.calibrate(scenes["pinhole"].corners, reference="view00").camera
    assert camera.noise_px == results["pinhole"].noise_px


def test_residuals_stand_beside_the_corners(scenes: dict[str, Scene], results: dict[str, JointResult]) -> None:
    result, view = results["fisheye"], scenes["fisheye"].corners.views[4]
    predicted = result.camera.project(result.poses[view.name].apply(view.lattice(BOARD)))
    np.testing.assert_allclose(view.uv - predicted, result.residuals[view.name], atol=1e-5)


def test_partial_boards_and_weights(scenes: dict[str, Scene]) -> None:
    rng = np.random.default_rng(3)
    views = [
        view.select(rng.random(54) < 0.6) if i else view
        for i, view in enumerate(scenes["pinhole"].corners.views)
    ]
    worse = 2  # this view is noisier, and says so
    view = views[worse]
    views[worse] = replace(view, uv=view.uv + rng.normal(0, 1.0, view.uv.shape), weights=np.full(len(view), 0.1))
    result = refine(CornerSet(BOARD, SIZE, tuple(views)), reference="view00")
    assert not result.dropped
    assert covered_error(scenes["pinhole"], result) < 2 * BOUND["pinhole"]
    assert result.noise_px == pytest.approx(0.1, rel=0.1)


def spoilt(scene: Scene, *, wrong: float, reversed_views: tuple[int, ...], moved: int) -> CornerSet:
    rng = np.random.default_rng(4)
    views = []
    for i, view in enumerate(scene.corners.views):
        uv = np.array(view.uv)
        hit = rng.random(len(uv)) < wrong
        uv[hit] += rng.uniform(-30, 30, (hit.sum(), 2))
        ids = view.ids
        if i in reversed_views:
            ids = ids // BOARD.columns * BOARD.columns + BOARD.columns - 1 - ids % BOARD.columns
        if i == moved:
            uv[: len(uv) // 2] += [3.0, -2.0]
        views.append(Corners(view.name, ids, uv))
    return CornerSet(BOARD, SIZE, tuple(views))


def test_wrong_corners_and_boards_are_named_and_do_no_harm(
    scenes: dict[str, Scene], results: dict[str, JointResult]
) -> None:
    scene = scenes["pinhole"]
    result = refine(spoilt(scene, wrong=0.05, reversed_views=(3, 7), moved=9), reference="view00")
    assert set(result.dropped) == {"view03", "view07", "view09"}
    assert covered_error(scene, result) < max(2.0 * covered_error(scene, results["pinhole"]), 0.1)
    assert sum(result.dropped_corners.values()) == pytest.approx(0.05 * 54 * 11, abs=12)


def test_a_half_turn_of_a_board_changes_nothing(scenes: dict[str, Scene], results: dict[str, JointResult]) -> None:
    views = list(scenes["wavy"].corners.views)
    views[4] = Corners(views[4].name, 53 - views[4].ids, views[4].uv)
    result = refine(CornerSet(BOARD, SIZE, tuple(views)), reference="view00")
    uv = grid(result)
    before, after = results["wavy"].camera.to_rays(uv), result.camera.to_rays(uv)
    np.testing.assert_allclose(before.directions, after.directions, atol=1e-6)


def test_a_reflection_with_left_handed_lattices(scenes: dict[str, Scene], results: dict[str, JointResult]) -> None:
    """The same views in a mirror: u reversed. The camera behind the mirror is the same."""
    views = [
        Corners(v.name, v.ids, np.column_stack([SIZE[0] - 1 - v.uv[:, 0], v.uv[:, 1]]))
        for v in scenes["pinhole"].corners.views
    ]
    result = refine(CornerSet(BOARD, SIZE, tuple(views)), reference="view00", mirrored=True)
    uv = grid(results["pinhole"])
    mirrored = np.column_stack([SIZE[0] - 1 - uv[:, 0], uv[:, 1]])
    np.testing.assert_allclose(
        result.camera.to_rays(mirrored).directions, results["pinhole"].camera.to_rays(uv).directions, atol=1e-6
    )
    assert result.camera.mirrored
    np.testing.assert_allclose(result.residuals["view03"], results["pinhole"].residuals["view03"] * [-1, 1], atol=1e-4)


def test_a_sheared_print_is_found() -> None:
    scene = make_scene("pinhole", views=20, shear=0.003, seed=2)
    result = refine(scene.corners, reference="view00")
    assert result.shape.shear == pytest.approx(0.003, rel=0.2)
    assert covered_error(scene, result) < 0.1


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_a_cockled_board_is_found(lens: str) -> None:
    """Its corners where they are, the lens as well as ever, and a noise that is the corners' alone."""
    shifts = cockled(0.004, seed=1)
    scene = make_scene(lens, views=20, warp=shifts, seed=1)
    result = refine(scene.corners, reference="view00")
    found = result.shape.points - np.column_stack([lattice(BOARD) - lattice(BOARD).mean(axis=0), np.zeros(54)])
    planes = np.column_stack([np.ones(54), lattice(BOARD)])
    found -= planes @ np.linalg.lstsq(planes, found, rcond=None)[0]
    assert result.shape.warp == pytest.approx(0.004 * np.sqrt(2.0), rel=0.1)
    assert np.sqrt(((found - shifts)[:, :2] ** 2).mean()) < 0.0007
    assert np.sqrt(((found - shifts)[:, 2] ** 2).mean()) < 0.002
    assert result.noise_px == pytest.approx(0.1, rel=0.04)
    assert covered_error(scene, result) < 2.0 * BOUND[lens]
    true = make_scene(lens, views=20, seed=1)
    moved = np.sqrt(np.mean([(v.uv - w.uv) ** 2 for v, w in zip(scene.corners.views, true.corners.views, strict=True)]))
    limit = result.camera.domain.max_std / (5.0 * result.disagreement)
    assert limit == pytest.approx(np.hypot(0.1, moved), rel=0.15)


def moved_px(scene: Scene, still: Scene) -> float:
    """By how much boards that moved differ from those that did not, beyond any pose: rms px an axis."""
    left = []
    for view, other, rotation, translation in zip(
        scene.corners.views, still.corners.views, still.rotations, still.translations, strict=True
    ):
        points = np.column_stack([lattice(BOARD), np.zeros(54)]) @ rotation.T
        steps = 1e-6 * np.eye(6)
        by_pose = [
            (still.project(Rotation.from_rotvec(s[:3]).apply(points) + translation + s[3:]) - other.uv).ravel() / 1e-6
            for s in steps
        ]
        basis = np.linalg.qr(np.array(by_pose).T)[0]
        apart = (view.uv - other.uv).ravel()
        left.append(apart - basis @ (basis.T @ apart))
    return float(np.sqrt(np.mean(np.square(left))))


def test_boards_that_move_while_the_shutter_rolls() -> None:
    """Without their motions f is off by several standard deviations, and the noise too large."""
    z, ratios = [], []
    for seed in range(6):
        scene = make_scene("pinhole", views=14, motion=0.004, seed=seed)
        result = refine(scene.corners, reference="view00")
        exact = [make_scene("pinhole", views=14, motion=motion, seed=seed, noise=0.0) for motion in (0.004, 0.0)]
        if all(np.array_equal(exact[0].rotations, one.rotations) for one in (scene, exact[1])):
            ratios.append(result.motion_px / moved_px(*exact))
        k = result.camera.intrinsics
        z.append((np.array([k.f, k.uc, k.vc]) - true_intrinsics(scene)) / result.intrinsics_std)
    assert np.sqrt(np.mean(np.square(z))) < 1.5
    assert len(ratios) >= 3
    assert ratios == pytest.approx([1.0] * len(ratios), abs=0.2)


def test_one_board_that_moved_is_trusted_less_and_moves_no_other() -> None:
    scene = make_scene("pinhole", views=14)
    moved = make_scene("pinhole", views=14, motion=0.02)
    views = [moved.corners.views[i] if i == 5 else view for i, view in enumerate(scene.corners.views)]
    result = refine(scene.corners.with_views(views), reference="view00")
    assert result.motion_px == 0.0
    assert covered_error(scene, result) < BOUND["pinhole"]


def test_a_noisy_board_counts_as_much_as_it_is_worth() -> None:
    """Weights that the caller knows, and weights that the boards tell, make the same camera."""
    scene, rng = make_scene("pinhole", views=14), np.random.default_rng(0)
    noisy = {"view03", "view07", "view11"}
    views = [
        replace(v, uv=v.uv + rng.normal(0, 0.4, v.uv.shape)) if v.name in noisy else v for v in scene.corners.views
    ]
    known = [replace(v, weights=np.full(54, 1 / np.sqrt(17.0))) if v.name in noisy else v for v in views]
    told, found = (refine(scene.corners.with_views(each), reference="view00") for each in (known, views))
    assert found.inliers["view03"].all()
    assert covered_error(scene, found) < 1.3 * covered_error(scene, told) + 0.01
    assert found.intrinsics_std == pytest.approx(told.intrinsics_std, rel=0.25)
    assert found.noise_px == pytest.approx(np.sqrt((11 * 0.01 + 3 * 0.17) / 14), rel=0.1)
    for name, noise in found.board_noise_px.items():
        assert noise == pytest.approx(np.sqrt(0.17) if name in noisy else 0.1, rel=0.4)
    assert not found.dropped


def test_a_bowed_and_stretched_board_is_found() -> None:
    scene = make_scene("pinhole", views=20, bow=0.06, stretch=0.004, seed=2)
    result = refine(scene.corners, reference="view00")
    assert result.shape.bow == pytest.approx(0.06, rel=0.1)
    assert result.shape.stretch == pytest.approx(0.004, rel=0.2)
    assert covered_error(scene, result) < 2.5 * BOUND["pinhole"]


def of_some_part(scene: Scene, names: set[str]) -> CornerSet:
    """The views of ``names`` without the last two columns, numbered as if the first two were missing."""
    views = []
    for view in scene.corners.views:
        if view.name in names:
            part = view.select(view.ids % BOARD.columns < BOARD.columns - 2)
            view = replace(part, ids=part.ids + 2, ambiguous_offset=True)
        views.append(view)
    return scene.corners.with_views(views)


@pytest.mark.parametrize("bow", [0.0, 0.1])
def test_which_part_of_a_board_is_seen_matters_not(bow: float) -> None:
    """A shift by whole squares is the pose's, on a flat board and, but for a tilt, on one with a quadratic height."""
    scene, some = make_scene("pinhole", views=20, bow=bow, seed=2), {"view04", "view09", "view12"}
    placed = of_some_part(scene, some)
    known = placed.with_views(replace(v, ids=v.ids - 2) if v.name in some else v for v in placed.views)
    one, two = (refine(corners, reference="view00") for corners in (placed, known))
    assert not one.dropped
    uv = grid(one)
    apart = ray_errors_px(scene, uv, one.camera.to_rays(uv).directions) - ray_errors_px(
        scene, uv, two.camera.to_rays(uv).directions
    )
    assert np.abs(apart).max() < (0.02 if bow else 1e-4)
    if bow:
        assert one.shape.bow == pytest.approx(bow, rel=0.1)


def test_a_flat_board_is_left_flat(results: dict[str, JointResult]) -> None:
    assert results["pinhole"].shape.bow is None
    assert results["pinhole"].shape.stretch is None
    assert results["pinhole"].shape.warp is None
    assert not results["pinhole"].shape.points[:, 2].any()
    assert [result.motion_px for result in results.values()] == [0.0] * len(results)
    for result in results.values():
        assert set(result.board_noise_px.values()) == {result.noise_px}
        assert result.camera.domain.max_std == pytest.approx(5.0 * result.noise_px * result.disagreement)


def test_the_reference_must_be_usable(scenes: dict[str, Scene]) -> None:
    corners = scenes["pinhole"].corners
    with pytest.raises(CalibrationError, match="not among"):
        refine(corners, reference="nowhere")
    with pytest.raises(CalibrationError, match="needs at least 3"):
        refine(corners.with_views(corners.views[:2]), reference="view00")
    bad = spoilt(scenes["pinhole"], wrong=0.0, reversed_views=(0,), moved=-1)
    with pytest.raises(CalibrationError, match="reversed"):
        refine(bad, reference="view00")
    assert refine(bad, reference="view00", stand_ins=["view03", "view05"]).reference == "view03"


def test_a_named_trend_and_kernel_are_used(scenes: dict[str, Scene]) -> None:
    lines: list[str] = []
    result = refine(
        scenes["wavy"].corners, reference="view00", trend="plane:2", kernel="matern52", progress=lines.append
    )
    assert result.trend.startswith("plane:2")
    assert result.kernel == "matern52"
    assert any("noise" in line for line in lines)


@pytest.mark.slow
def test_predicted_standard_deviations_are_those_of_new_noise() -> None:
    """Monte Carlo over the noise of the whole calibration, in the frame of the reference board."""
    scene = make_scene("fisheye", noise=0.0)
    rng = np.random.default_rng(0)
    u, v = np.meshgrid([150.0, 400.0, 650.0], [120.0, 300.0, 480.0])
    uv = np.column_stack([u.ravel(), v.ravel()])
    draws = 60
    ks, stds, rays, predicted = [], [], [], []
    for _ in range(draws):
        views = [replace(v, uv=v.uv + rng.normal(0, 0.1, v.uv.shape)) for v in scene.corners.views]
        result = refine(scene.corners.with_views(views), reference="view00")
        k, seen = result.camera.intrinsics, result.camera.to_rays(uv)
        ks.append([k.f, k.uc, k.vc])
        stds.append(result.intrinsics_std)
        rays.append(seen.directions)
        predicted.append(seen.std_px)
    within = np.abs(np.array(ks) - true_intrinsics(scene)) < 1.96 * np.array(stds)
    assert 0.88 < within.mean() <= 1.0
    np.testing.assert_allclose(np.std(ks, axis=0, ddof=1) / np.mean(stds, axis=0), 1.0, atol=0.25)
    camera = result.camera
    to_px = np.linalg.pinv(camera.chart.direction_jacobian(camera.plane_map.value(uv)) @ camera.plane_map.jacobian(uv))
    moved = np.einsum("nij,dnj->dni", to_px, np.array(rays) - np.mean(rays, axis=0))
    sampled = np.sqrt((moved**2).mean(axis=(0, 2)) * draws / (draws - 1))
    np.testing.assert_allclose(sampled / np.sqrt(np.mean(np.square(predicted), axis=0)), 1.0, atol=0.25)


@pytest.mark.parametrize("seed", [1, 3, 4, 6, 8, 10])
def test_error_bars_hold_where_the_boards_hardly_tell_two_lenses_apart(seed: int) -> None:
    """Nearly parallel boards: by a nat or two the evidence prefers a law that is not the lens's, pixels off."""
    scene = make_scene("equisolid", views=10, tilt=6.0, seed=seed)
    result = refine(scene.corners, reference="view00")
    promised = np.sqrt(2.0 * (result.camera.shape_std(grid(result)) ** 2).mean())
    assert covered_error(scene, result) < 3.0 * promised


@pytest.mark.parametrize("together", [0.0, 2.0])
def test_boards_that_pull_apart_widen_the_error_bars(together: float) -> None:
    """Each board sheared as a rolling shutter does, which no noise of single corners explains."""
    scene = make_scene("pinhole", views=14)
    rng = np.random.default_rng(5)
    views = []
    for view in scene.corners.views:
        shear = together * rng.normal(size=2)
        along = (view.uv[:, 1] - view.uv[:, 1].mean()) / SIZE[1]
        views.append(replace(view, uv=view.uv + along[:, None] ** 2 * shear * 4.0))
    result = refine(scene.corners.with_views(views), reference="view00")
    promised = np.sqrt(2.0 * (result.camera.shape_std(grid(result)) ** 2).mean())
    assert (result.disagreement > 1.0) == bool(together)
    assert covered_error(scene, result) < 3.0 * promised


@pytest.mark.parametrize("seed", range(3))
def test_four_boards_tell_a_stretched_print_from_pixels_that_are_not_square(seed: int) -> None:
    scene = make_scene("pinhole", views=4, stretch=0.005, seed=seed)
    result = refine(scene.corners, reference="view00")
    promised = np.sqrt(2.0 * (result.camera.shape_std(grid(result)) ** 2).mean())
    assert covered_error(scene, result) < 3.0 * promised


def test_four_boards_that_moved_are_not_taken_for_a_stretched_print() -> None:
    """So few tell one from the other as little as from an uneven board: they get neither, and it is said."""
    scene = make_scene("pinhole", views=4, motion=0.01, seed=4)
    result = refine(scene.corners, reference="view00")
    assert result.too_few
    assert result.motion_px == 0.0
    assert result.shape.stretch is None
    still = refine(make_scene("pinhole", views=4, stretch=0.005).corners, reference="view00")
    assert not still.too_few
    assert still.shape.stretch == pytest.approx(0.005, rel=0.1)


@pytest.mark.parametrize("name", ["pinhole", "fisheye"])
def test_five_boards_tell_their_own_shape(name: str) -> None:
    found = []
    for seed in range(4):
        scene = make_scene(name, views=5, warp=cockled(0.006, seed), seed=seed)
        result = refine(scene.corners, reference="view00")
        assert not result.too_few
        found += [result.shape.warp] if result.shape.warp is not None else []
    assert len(found) >= 3
    assert found == pytest.approx([0.006 * np.sqrt(2.0)] * len(found), rel=0.25)  # of shifts along both axes
