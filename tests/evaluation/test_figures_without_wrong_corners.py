"""Wrong corners are counted and named, in no figure of any method, and cannot hide a camera that is wrong."""

import dataclasses

import numpy as np
import pytest

from pinholify.cli.evaluation_output import to_json
from pinholify.corners import Corners, CornerSet
from pinholify.evaluation.summary import evaluate
from pinholify.evaluation.verdict import judge, noise_floor, residuals_of
from pinholify.evaluation.wrong_corners import TOO_MANY, WrongCorners, sentences, wrong_corners
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.pipeline import calibrate
from pinholify.report.boards import boards_of
from pinholify.report.pictures import Pictures
from synthetic import BOARD, SIZE, corner_set

SHARE, REVERSED = 0.05, "view3.png"


def joint(corners: CornerSet, reference: str = "view0.png"):
    return calibrate(corners, reference=reference, method="joint")


def replaced(view: Corners, uv) -> Corners:
    return dataclasses.replace(view, uv=uv)


def scored(calibration, corners, **options):
    return evaluate(calibration, corners, recalibrate=joint, **options)


@pytest.fixture(scope="module")
def honest() -> CornerSet:
    return corner_set(12, squeeze=0.15)


@pytest.fixture(scope="module")
def spoilt(honest):
    """The set with gross errors and a board counted backwards, and which corners (by view) were moved."""
    rng = np.random.default_rng(4)
    views, moved = [], {}
    for view in honest.views:
        hit = rng.random(len(view)) < SHARE
        angle, length = rng.uniform(0, 2 * np.pi, len(view)), rng.uniform(5, 50, len(view)) * hit
        uv = view.uv + length[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        ids = view.ids.reshape(BOARD.rows, -1)[:, ::-1].ravel() if view.name == REVERSED else view.ids
        views.append(Corners(view.name, ids, uv))
        moved[view.name] = hit
    return honest.with_views(views), moved


@pytest.fixture(scope="module")
def calibration(spoilt):
    return joint(spoilt[0])


@pytest.fixture(scope="module")
def evaluation(calibration, spoilt):
    return scored(calibration, spoilt[0])


@pytest.fixture(scope="module")
def by_hand(calibration, spoilt):
    """The evaluation of the same camera on the corners that were not moved."""
    corners, moved = spoilt
    freed = corners.with_views(view.select(~moved[view.name]) for view in corners.views)
    return scored(joint(freed), freed), freed


def test_the_moved_corners_are_named_and_no_others(calibration, spoilt, evaluation):
    corners, moved = spoilt
    known = wrong_corners(calibration, calibration.corner_set)
    assert {name: hit.tolist() for name, hit in moved.items() if hit.any()} == {
        name: mask.tolist() for name, mask in known.masks.items()
    }
    assert evaluation.wrong.count == sum(hit.sum() for hit in moved.values())
    assert evaluation.wrong.found == sum(len(view) for view in corners.views)
    assert {b.file: b.wrong for b in evaluation.boards} == {name: hit.sum() for name, hit in moved.items()}
    assert all(b.corners == 135 and b.inside == 135 - b.wrong for b in evaluation.boards if b.used)


def test_every_measure_is_that_of_the_corners_that_belong(evaluation, by_hand):
    freed, _ = by_hand
    for name in ("heldout_px", "pinholeness"):
        assert getattr(evaluation, name) == pytest.approx(getattr(freed, name), rel=0.02)
    assert dataclasses.astuple(evaluation.pooled) == pytest.approx(dataclasses.astuple(freed.pooled), rel=0.02)
    for model, score in freed.opencv.items():
        assert dataclasses.astuple(evaluation.opencv[model]) == pytest.approx(dataclasses.astuple(score), rel=0.02)


def test_the_verdict_is_that_of_the_corners_that_belong_and_says_what_was_left_out(evaluation, by_hand, spoilt):
    freed, corners = by_hand
    verdict, without = judge(evaluation, spoilt[0]), judge(freed, corners)
    assert verdict.level == without.level != "poor"
    assert verdict.structure.p_value == pytest.approx(without.structure.p_value, abs=0.05)
    assert verdict.suspicious == ()
    assert f"{evaluation.wrong.count} of 1620 corners are wrong and were left out" in verdict.sentence
    assert "left out" not in without.sentence
    doubted = spoilt[0].with_views(
        dataclasses.replace(view, weights=np.where(spoilt[1][view.name], 0.1, 1.0)) for view in spoilt[0].views
    )
    assert noise_floor(evaluation, doubted) == pytest.approx(noise_floor(freed, corners), rel=0.02)


def test_residuals_stand_beside_their_corners(evaluation, spoilt):
    corners, moved = spoilt
    seen = residuals_of(evaluation, corners)
    for name, hit in moved.items():
        assert (seen.inliers[name] == ~hit).all()
        assert np.isnan(seen.residuals[name][hit]).all()
        assert np.linalg.norm(seen.residuals[name][~hit], axis=1).max() < 0.6


def test_it_is_said_in_json_and_in_the_report(calibration, evaluation, spoilt):
    corners, moved = spoilt
    verdict = judge(evaluation, corners)
    told = to_json(evaluation, verdict)
    assert told["wrong_corners"]["count"] == evaluation.wrong.count
    assert told["wrong_corners"]["share"] == pytest.approx(evaluation.wrong.count / (12 * 135))
    assert told["wrong_corners"]["by_image"] == {name: hit.sum() for name, hit in moved.items() if hit.any()}
    assert [board["wrong"] for board in told["boards"]] == [hit.sum() for hit in moved.values()]
    entries = boards_of(evaluation, verdict, residuals_of(evaluation, calibration.corner_set), Pictures())
    assert all((entry.wrong == moved[entry.name]).all() and entry.dropped == entry.wrong.sum() for entry in entries)


def test_the_camera_file_s_own_corners_are_known_and_others_are_not(calibration, spoilt):
    strangers = corner_set(4, squeeze=0.15, seed=8)
    assert wrong_corners(calibration, strangers).count == 0
    evaluation = evaluate(calibration, strangers)
    freed = wrong_corners(calibration, calibration.corner_set).left_out_of(calibration.corner_set)
    trained = evaluate(dataclasses.replace(calibration, corner_set=freed, details={}), strangers)
    assert evaluation.opencv["opencv5"].heldout_px == pytest.approx(trained.opencv["opencv5"].heldout_px, rel=1e-6)


@pytest.mark.parametrize(("share", "poor"), [(TOO_MANY - 0.005, False), (TOO_MANY + 0.005, True)])
def test_too_many_make_it_poor(evaluation, spoilt, share, poor):
    wrong = dataclasses.replace(evaluation.wrong, found=round(evaluation.wrong.count / share))
    verdict = judge(dataclasses.replace(evaluation, wrong=wrong), spoilt[0])
    assert (verdict.level == "poor") == poor
    assert ("too many to be wrong corners alone" in verdict.sentence) == poor
    assert ("too many" in sentences(wrong)[1]) == poor


def test_a_fault_of_the_camera_does_not_pass_for_wrong_corners(honest):
    def faulty(view: Corners) -> Corners:
        hit = np.linalg.norm(view.uv - [1100.0, 600.0], axis=1) < 0.1 * SIZE[0]
        return replaced(view, view.uv + np.where(hit[:, None], [3.0, 1.5], 0.0))

    corners = honest.with_views(map(faulty, honest.views))
    calibration = joint(corners)
    evaluation = evaluate(calibration, corners, compare_opencv=False)
    verdict = judge(evaluation, corners)
    assert evaluation.wrong.count > 20
    assert verdict.left_out.p_value < 1e-4
    assert verdict.level == "poor"
    assert "the wrong corners share a common error" in verdict.sentence


def test_chance_errors_are_not_alike(evaluation, spoilt):
    assert judge(evaluation, spoilt[0]).left_out.p_value > 1e-3


def test_sentences_are_short_and_in_order():
    few = WrongCorners({"a": np.array([True, False]), "b": np.array([True, True])}, 1000)
    assert sentences(few) == ("3 of 1000 corners are wrong and were left out of every number: b 2, a 1.",)
    one = WrongCorners({"a": np.array([True, False])}, 10_000)
    assert sentences(one) == ("1 of 10000 corners is wrong and was left out of every number: a 1.",)
    many = WrongCorners({f"{k}": np.ones(3, dtype=bool) for k in range(20)}, 1000)
    assert "and 12 more images" in sentences(many)[0]
    assert sentences(many)[1].startswith("That is 6.0 %")
    assert sentences(WrongCorners({}, 1000)) == ()


def test_corners_of_a_board_too_dense_to_be_solved_whole_are_judged_each(honest, monkeypatch, tmp_path):
    rng = np.random.default_rng(2)
    hit = {view.name: rng.random(len(view)) < 0.003 for view in honest.views}
    views = [replaced(view, view.uv + 30.0 * hit[view.name][:, None]) for view in honest.views]
    monkeypatch.setattr("pinholify.pipeline.MAX_JOINT_CORNERS", 100)
    monkeypatch.setattr("pinholify.pipeline.MIN_CORNERS_PER_BOARD", 20)
    calibration = joint(honest.with_views(views))
    found = wrong_corners(calibration, calibration.corner_set)
    assert sum(len(each) for each in calibration.details["wrong_corners"].values()) == found.count
    write_camera(tmp_path / "c.npz", calibration)
    assert wrong_corners(read_camera(tmp_path / "c.npz"), calibration.corner_set).count == found.count
    moved = sum(mask.sum() for mask in hit.values())
    assert sum((found.masks[name] & mask).sum() for name, mask in hit.items() if mask.any()) == moved
    assert moved <= found.count <= moved + 3


def test_a_board_with_many_more_than_the_others_is_named(evaluation):
    def some(count: int, size: int = 40):
        return np.arange(size) < count

    assert WrongCorners({"a": some(5), "b": some(1)}, 2000).crowded == ("a",)
    assert WrongCorners({"a": some(3), "b": some(1)}, 2000).crowded == ()  # less than a tenth
    assert WrongCorners({f"{k}": some(5) for k in range(50)}, 2000).crowded == ()  # as many as the others
    assert WrongCorners({"a": some(1, 8)}, 2000).crowded == ()  # chance
    assert evaluation.wrong.crowded == ()


def test_a_camera_with_such_a_board_is_no_more_than_fair(honest):
    rng = np.random.default_rng(1)
    views = list(honest.views)
    hit = rng.permutation(135) < 27
    views[4] = replaced(views[4], views[4].uv + 20.0 * hit[:, None] * rng.normal(size=(135, 2)))
    corners = honest.with_views(views)
    calibration = joint(corners)
    evaluation = evaluate(calibration, corners, compare_opencv=False)
    verdict = judge(evaluation, corners)
    assert evaluation.wrong.crowded == (views[4].name,)
    assert verdict.level == "fair"
    assert f"boards with too many wrong corners: {views[4].name}" in verdict.sentence
    assert verdict.suspicious == ()
