"""The verdict says what is true of cameras that are good, thinly covered, or wrong."""

import dataclasses
from functools import partial

import numpy as np
import pytest

from pinholify.calibration.observation import map_board
from pinholify.errors import UnsolvableError
from pinholify.evaluation.summary import NOT_REQUESTED, HeldOut, OpenCVScore, evaluate
from pinholify.evaluation.verdict import cell_centres, coverage, judge, noise_floor, place
from pinholify.geometry import Pose
from pinholify.pipeline import calibrate
from pinholify.pipeline import recalibrate as again
from pinholify.refinement.diagnosis import NextBoard
from synthetic import corner_set


def judged(calibration, corners):
    evaluation = evaluate(
        calibration,
        corners,
        recalibrate=lambda part, name: calibrate(part, reference=name, method="one-image", trend="lens:3"),
        compare_opencv=False,
    )
    return judge(evaluation, corners)


def test_a_good_camera_is_said_to_be_good_or_thinly_covered(barrel_set, barrel_calibration):
    verdict = judged(barrel_calibration, barrel_set)
    assert verdict.level == ("good" if verdict.coverage >= 0.6 else "fair")
    assert verdict.sentence.startswith(verdict.level.capitalize())
    assert verdict.structure.p_value > 1e-3
    assert not verdict.suspicious
    assert verdict.coverage == pytest.approx(coverage(barrel_calibration.camera))


def test_the_noise_floor_counts_the_corners_weights(barrel_set, barrel_calibration):
    evaluation = evaluate(barrel_calibration, barrel_set, compare_opencv=False)
    halved = barrel_set.with_views([dataclasses.replace(v, weights=v.weights / 2) for v in barrel_set.views])
    floor = noise_floor(evaluation, barrel_set)
    assert floor == pytest.approx(np.sqrt(2) * barrel_calibration.camera.noise_px)
    assert noise_floor(evaluation, halved) == pytest.approx(2 * floor)


@pytest.mark.parametrize("method", ["joint", "one-image"])
@pytest.mark.parametrize("factor", [0.1, 7.0, 1000.0])
def test_only_ratios_of_weights_matter(method, factor):
    rng = np.random.default_rng(0)
    views = corner_set(10, squeeze=0.1).views
    noisy = {"view3.png", "view8.png"}
    weights = {v.name: np.full(len(v), 0.25 if v.name in noisy else 1.0) for v in views}
    shaken = [
        dataclasses.replace(v, uv=v.uv + 0.4 * rng.normal(size=v.uv.shape)) if v.name in noisy else v for v in views
    ]
    found = []
    for scale in (1.0, factor):
        corners = corner_set(10).with_views(dataclasses.replace(v, weights=scale * weights[v.name]) for v in shaken)
        calibration = calibrate(corners, reference="view0.png", method=method)
        np.testing.assert_array_equal(calibration.corner_set.views[3].weights, corners.views[3].weights)
        evaluation = evaluate(calibration, corners, recalibrate=partial(again, calibration), compare_opencv=False)
        found.append((calibration, evaluation, judge(evaluation, corners), noise_floor(evaluation, corners)))
    (one, first, said, floor), (other, second, says, same_floor) = found
    assert other.camera.noise_px == pytest.approx(factor * one.camera.noise_px, rel=1e-6)
    assert other.camera.intrinsics.f == pytest.approx(one.camera.intrinsics.f, rel=1e-9)
    np.testing.assert_allclose(other.intrinsics_std, one.intrinsics_std, rtol=1e-6)
    assert other.camera.domain.max_std == pytest.approx(one.camera.domain.max_std, rel=1e-6)
    assert second.heldout_px == pytest.approx(first.heldout_px, rel=1e-6)
    assert [b.misfit_px for b in second.boards] == pytest.approx([b.misfit_px for b in first.boards], rel=1e-5)
    assert same_floor == pytest.approx(floor, rel=1e-6)
    assert says.sentence == said.sentence
    assert (says.next_board is None) == (method == "one-image")
    if said.next_board is not None:
        assert says.next_board.std_after == pytest.approx(said.next_board.std_after, rel=1e-6)


def test_a_board_that_looks_wrong_is_named(barrel_set, barrel_calibration):
    rng = np.random.default_rng(0)
    shaken = [
        dataclasses.replace(v, uv=v.uv + 0.6 * rng.normal(size=v.uv.shape)) if v.name == "view4.png" else v
        for v in barrel_set.views
    ]
    verdict = judged(barrel_calibration, barrel_set.with_views(shaken))
    assert [s.name for s in verdict.suspicious] == ["view4.png"]
    assert "view4.png" in verdict.sentence
    assert verdict.level == "fair"


def test_errors_finer_than_corners_are_found_say_nothing():
    corners = corner_set(12, noise=0.002)
    rng = np.random.default_rng(0)
    shaken = [
        dataclasses.replace(v, uv=v.uv + 0.008 * rng.normal(size=v.uv.shape)) if v.name == "view4.png" else v
        for v in corners.views
    ]
    verdict = judged(calibrate(corners, reference="view0.png", method="joint"), corners.with_views(shaken))
    assert verdict.suspicious == ()
    assert "suspicious" not in verdict.sentence
    assert "noise alone" not in verdict.sentence


def test_where_no_held_out_error_is_asked_for_the_error_in_sample_counts(barrel_calibration):
    other = corner_set(squeeze=0.15, noise=2.0, seed=3)
    evaluation = evaluate(barrel_calibration, other, compare_opencv=False)
    unasked = dataclasses.replace(evaluation, heldout=NOT_REQUESTED)
    verdict = judge(unasked, other)
    assert verdict.level == "poor"
    assert "in-sample error" in verdict.sentence


def test_what_was_not_asked_for_is_not_held_against_a_camera(barrel_set, barrel_calibration):
    verdict = judge(evaluate(barrel_calibration, barrel_set, compare_opencv=False), barrel_set)
    assert verdict.level != "poor"
    assert "no held-out error was requested" in verdict.sentence


def test_no_words_decide_whether_a_held_out_error_was_asked_for(barrel_set, barrel_calibration):
    evaluation = evaluate(barrel_calibration, barrel_set, compare_opencv=False)
    failed = dataclasses.replace(evaluation, heldout=HeldOut(None, NOT_REQUESTED.reason))
    assert judge(failed, barrel_set).level == "poor"
    assert "no held-out error (not requested)" in judge(failed, barrel_set).sentence


class Folded:
    """A map that is nowhere one to one."""

    def __init__(self, plane_map):
        self.value = plane_map.value

    def jacobian(self, uv):
        return np.zeros((len(uv), 2, 2))


def folded(calibration):
    camera = dataclasses.replace(calibration.camera, plane_map=Folded(calibration.camera.plane_map))
    return dataclasses.replace(calibration, camera=camera)


def test_a_camera_of_unknown_noise_is_compared_with_opencvs_models(barrel_set, barrel_calibration):
    camera = dataclasses.replace(barrel_calibration.camera, noise_px=float("nan"))
    evaluation = evaluate(dataclasses.replace(barrel_calibration, camera=camera), barrel_set)
    error = evaluation.pooled.re_px
    for ratio, level in ((0.5, "fair"), (1.0, "good")):
        score = OpenCVScore(ratio * error, 1.0, None)
        verdict = judge(dataclasses.replace(evaluation, opencv={"opencv5": score}), barrel_set)
        assert ("OpenCV" in verdict.sentence) == (level == "fair")
        assert verdict.level != "good" or level == "good"


def without_solution(part, name):
    raise UnsolvableError("equations without a solution")


def test_a_held_out_error_without_a_solution_is_unknown_and_says_why(barrel_set, barrel_calibration):
    for recalibrate, reason in (
        (lambda part, name: folded(barrel_calibration), "a held-out board could not be located"),
        (without_solution, "half of the boards do not determine a camera"),
    ):
        evaluation = evaluate(barrel_calibration, barrel_set, recalibrate=recalibrate, compare_opencv=False)
        assert evaluation.heldout_px is None
        assert reason in evaluation.heldout.reason
        verdict = judge(evaluation, barrel_set)
        assert verdict.level == "poor"
        assert f"no held-out error ({reason}" in verdict.sentence


def test_equations_without_a_solution_are_an_error_of_the_package(barrel_set, barrel_calibration, monkeypatch):
    def singular(*_, **__):
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr("pinholify.calibration.one_image.find_intrinsics", singular)
    with pytest.raises(UnsolvableError, match="Singular matrix"):
        calibrate(barrel_set, method="one-image")
    monkeypatch.setattr("pinholify.evaluation.summary.observe", singular)
    with pytest.raises(UnsolvableError, match="equations without a solution"):
        evaluate(barrel_calibration, barrel_set)


def test_corners_where_the_map_is_not_one_to_one_do_not_count(barrel_set, barrel_calibration):
    view = barrel_set.views[1]
    xy, jacobian = barrel_calibration.camera.plane_map.value(view.uv), np.tile(np.eye(2), (len(view), 1, 1))
    jacobian[:3], jacobian[3] = 0.0, np.nan
    board = map_board(view, barrel_set.board, np.ones(len(view), dtype=bool), xy, jacobian)
    assert board.used
    np.testing.assert_array_equal(np.flatnonzero(~board.inside), [0, 1, 2, 3])
    assert len(board.uv) == len(view) - 4


def of_noise(evaluation, noise_px, heldout_px):
    camera = dataclasses.replace(evaluation.calibration.camera, noise_px=noise_px)
    calibration = dataclasses.replace(evaluation.calibration, camera=camera)
    return dataclasses.replace(evaluation, calibration=calibration, heldout=HeldOut(heldout_px))


@pytest.mark.parametrize(
    ("noise_px", "heldout_px", "level"),
    [(0.4, 0.6, "good"), (0.6, 0.9, "fair"), (0.6, 1.8, "poor"), (2.3, 4.0, "poor")],
)
def test_noise_is_a_yardstick_only_while_it_is_that_of_corners(
    barrel_set, barrel_calibration, monkeypatch, noise_px, heldout_px, level
):
    monkeypatch.setattr("pinholify.evaluation.verdict.ENOUGH_COVERAGE", 0.0)
    evaluation = evaluate(barrel_calibration, barrel_set, compare_opencv=False)
    verdict = judge(of_noise(evaluation, noise_px, heldout_px), barrel_set)
    assert verdict.level == level
    assert (f"corner noise is {noise_px:.2g} px per axis, where 0.3 px" in verdict.sentence) == (noise_px > 0.5)


def test_boards_that_disagree_are_remarked_on(barrel_set, barrel_calibration):
    evaluation = evaluate(barrel_calibration, barrel_set, compare_opencv=False)
    assert "disagree" not in judge(evaluation, barrel_set).sentence
    calibration = dataclasses.replace(barrel_calibration, details={"disagreement": 3.93})
    verdict = judge(dataclasses.replace(evaluation, calibration=calibration), barrel_set)
    assert "the boards disagree 3.9 times as much as corner noise explains" in verdict.sentence
    elsewhere = judge(dataclasses.replace(evaluation, calibration=calibration, known=frozenset()), barrel_set)
    assert "the boards of its calibration disagree" in elsewhere.sentence


def test_a_camera_of_another_lens_is_poor(barrel_calibration):
    verdict = judged(barrel_calibration, corner_set(squeeze=0.15, noise=2.0, seed=3))
    assert verdict.level == "poor"


@pytest.mark.parametrize(
    ("centre", "words"),
    [
        ((500, 400), "in the middle"),
        ((100, 100), "at the upper left"),
        ((900, 400), "at the right"),
        ((500, 700), "at the bottom"),
    ],
)
def test_a_place_in_words(centre, words):
    outline = np.add(centre, [[-150, -90], [150, -90], [150, 90], [-150, 90]])
    facing = NextBoard(Pose(np.eye(3), np.zeros(3)), outline, 3.0, 1.0, 0.5)
    assert place(facing, (1000, 800)) == f"{words}, 30 % of the image wide"
    tilted = dataclasses.replace(facing, tilt_deg=24.6)
    assert place(tilted, (1000, 800)) == f"{words}, 30 % of the image wide, tilted by 25°"


def test_boards_too_few_to_tell_what_makes_them_differ_make_no_good_camera(barrel_set, barrel_calibration):
    assert "uneven" not in judge(evaluate(barrel_calibration, barrel_set, compare_opencv=False), barrel_set).sentence
    puzzled = dataclasses.replace(barrel_calibration, details={"too_few_boards": True})
    verdict = judge(evaluate(puzzled, barrel_set, compare_opencv=False), barrel_set)
    assert verdict.level == "fair"
    assert "more photographs would show which" in verdict.sentence


def test_the_sentence_is_composed_of_its_parts(barrel_set, barrel_calibration):
    verdict = judge(evaluate(barrel_calibration, barrel_set, compare_opencv=False), barrel_set)
    assert verdict.headline.startswith("in-sample error")
    parts = dataclasses.replace(
        verdict, level="fair", headline="held-out error 1 px", reasons=("a: b", "c"), advice="photograph more"
    )
    assert parts.sentence == "Fair: held-out error 1 px; a: b; c; photograph more."
    assert dataclasses.replace(parts, reasons=(), advice=None).sentence == "Fair: held-out error 1 px."


def test_cells_tile_an_image_whose_pixel_centres_are_integers():
    np.testing.assert_allclose(cell_centres((4, 3), 4, 3)[:5], [[0, 0], [1, 0], [2, 0], [3, 0], [0, 1]])
    np.testing.assert_allclose(cell_centres((8, 6), 2, 1), [[1.5, 2.5], [5.5, 2.5]])
