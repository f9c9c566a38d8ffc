import numpy as np
import pytest

from pinholify.calibration.numbering import handedness
from pinholify.calibration.poses import poses_of_directions
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CalibrationError
from pinholify.refinement import refine
from pinholify.refinement.observations import image_frame, lattice_middle, observations
from pinholify.refinement.outliers import locally_consistent, misfitting_boards, usable_views, with_enough
from pinholify.refinement.start import SimpleLens, scan, simple_lenses

from .conftest import BOARD, FOCAL, SIZE, Scene, make_scene

FRAME = image_frame(SIZE, False)


def true_directions(scene: Scene) -> np.ndarray:
    points = np.concatenate([v.lattice(BOARD) for v in scene.corners.views])
    view = np.repeat(np.arange(len(scene.rotations)), BOARD.columns * BOARD.rows)
    return np.einsum("nij,nj->ni", scene.rotations[view][:, :, :2], points) + scene.translations[view]


@pytest.mark.parametrize("name", ["pinhole", "fisheye"])
def test_poses_from_true_directions_are_exact(name: str) -> None:
    scene = make_scene(name, noise=0.0)
    seen = observations(scene.corners.views, BOARD, FRAME)
    rotations, translations = poses_of_directions(true_directions(scene), seen.lattice, seen.starts)
    middle = np.append(lattice_middle(BOARD), 0.0)
    np.testing.assert_allclose(rotations, scene.rotations, atol=1e-7)
    np.testing.assert_allclose(translations, scene.translations + scene.rotations @ middle, atol=1e-6)


@pytest.mark.parametrize("lens", simple_lenses(), ids=str)
def test_slope_of_a_simple_lens(lens: SimpleLens) -> None:
    r = np.linspace(0.05, 0.95, 10)
    numeric = 2e-6 / (lens.angle(r + 1e-6) - lens.angle(r - 1e-6))
    np.testing.assert_allclose(lens.slope(r), numeric, rtol=1e-6)
    np.testing.assert_allclose(lens.angle(np.array([1.0])), lens.corner_angle)


def test_scan_tells_a_pinhole_from_a_fisheye(scenes: dict[str, Scene]) -> None:
    best = {name: scan(observations(scenes[name].corners.views, BOARD, FRAME), 1)[0] for name in ("pinhole", "fisheye")}
    assert best["pinhole"].shape == 1.0
    assert np.tan(best["pinhole"].corner_angle) * FOCAL == pytest.approx(FRAME.scale, rel=0.2)
    assert best["fisheye"].shape < 1.0
    assert best["fisheye"].corner_angle > best["pinhole"].corner_angle


def test_a_reversed_axis_shows_in_the_handedness(scenes: dict[str, Scene]) -> None:
    good = scenes["pinhole"].corners.views[1]
    reversed_ids = good.ids // BOARD.columns * BOARD.columns + BOARD.columns - 1 - good.ids % BOARD.columns
    wrong = Corners("wrong", reversed_ids, good.uv)
    assert handedness(good, BOARD) > 0 > handedness(wrong, BOARD)
    few = Corners("few", good.ids[:3], good.uv[:3])
    line = Corners("line", good.ids[: BOARD.columns], good.uv[: BOARD.columns])
    usable, unusable = usable_views([good, wrong, few, line], BOARD, mirrored=False)
    assert [view.name for view in usable] == [good.name]
    assert set(unusable) == {"wrong", "few", "line"}
    assert "reversed" in unusable["wrong"]
    assert "3 corners" in unusable["few"]
    assert "line" in unusable["line"]


def test_what_neighbours_share_is_no_outlier(scenes: dict[str, Scene]) -> None:
    seen = observations(scenes["pinhole"].corners.views, BOARD, FRAME)
    rng = np.random.default_rng(0)
    smooth = 0.02 * np.sin(5.0 * seen.image)
    residual = smooth + 1e-4 * rng.normal(size=smooth.shape)
    wrong = rng.choice(len(residual), 30, replace=False)
    residual[wrong] += 0.05
    keep = locally_consistent(residual, seen)
    assert not keep[wrong].any()
    assert keep.sum() >= len(residual) - 30 - 8


def test_boards_that_do_not_fit_are_named_and_too_small_ones_left(scenes: dict[str, Scene]) -> None:
    seen = observations(scenes["pinhole"].corners.views, BOARD, FRAME)
    residual = 1e-4 * np.random.default_rng(0).normal(size=seen.image.shape)
    residual[seen.slices()[3]] *= 5.0
    residual[seen.slices()[5]] = np.nan
    assert set(misfitting_boards(residual, 1e-4, seen)) == {3, 5}
    keep = np.ones(len(residual), dtype=bool)
    keep[seen.slices()[2]][5:] = False
    assert not with_enough(seen, keep)[seen.slices()[2]].any()
    assert seen.select(with_enough(seen, keep)).boards == seen.boards - 1


def test_noise_without_boards_is_refused() -> None:
    rng = np.random.default_rng(0)
    views = [Corners(f"v{i}", np.arange(54), rng.uniform(0, 500, (54, 2))) for i in range(5)]
    seen = observations(views, BOARD, FRAME)
    assert scan(seen, 1)  # some lens is least bad; the refusal comes later
    corners = CornerSet(BOARD, SIZE, tuple(views))
    with pytest.raises(CalibrationError):
        refine(corners, reference="v0")
