"""The verdict says what is true of cameras that are good, thinly covered, or wrong."""

import dataclasses

import numpy as np
import pytest

from pinholify.evaluation.summary import NOT_ASKED, evaluate
from pinholify.evaluation.verdict import coverage, judge, noise_floor, place
from pinholify.geometry import Pose
from pinholify.pipeline import calibrate
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
    assert "look wrong" not in verdict.sentence
    assert "noise alone" not in verdict.sentence


def test_where_no_held_out_error_is_asked_for_the_error_in_sample_counts(barrel_calibration):
    other = corner_set(squeeze=0.15, noise=2.0, seed=3)
    evaluation = evaluate(barrel_calibration, other, compare_opencv=False)
    unasked = dataclasses.replace(evaluation, heldout_px=None, heldout_reason=NOT_ASKED)
    verdict = judge(unasked, other)
    assert verdict.level == "poor"
    assert "its own photographs are off by" in verdict.sentence


def test_what_was_not_asked_for_is_not_held_against_a_camera(barrel_set, barrel_calibration):
    verdict = judge(evaluate(barrel_calibration, barrel_set, compare_opencv=False), barrel_set)
    assert verdict.level != "poor"
    assert "not asked for" in verdict.sentence


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
    outline = np.add(centre, [[-10, -10], [10, -10], [10, 10], [-10, 10]])
    assert place(NextBoard(Pose(np.eye(3), np.zeros(3)), outline, 1.0, 0.5), (1000, 800)) == words
