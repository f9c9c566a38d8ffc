"""Photographs that a camera was made from are recognised though their corners differ a little, and no others are."""

import dataclasses

import numpy as np
import pytest

from pinholify.corners import Corners, not_found, same_photograph
from pinholify.evaluation.summary import evaluate
from pinholify.evaluation.wrong_corners import wrong_corners
from pinholify.pipeline import calibrate
from synthetic import corner_set

VIEW = corner_set(1).views[0]


def joint(corners, reference="view0.png"):
    return calibrate(corners, reference=reference, method="joint", trend="plane:1")


def rounded(view):
    """As a table gives them."""
    return dataclasses.replace(view, uv=view.uv.round(6))


def found_again(view):
    """Other corners of one photograph: fitted again, one in ten lost, in another order, two grossly elsewhere."""
    rng = np.random.default_rng(len(view.name))
    kept = rng.permutation(len(view))[len(view) // 10 :]
    uv = view.uv[kept] + rng.normal(0.0, 0.2, (len(kept), 2))
    uv[:2] += 30.0
    return Corners(view.name, view.ids[kept], uv)


def in_a_folder(view):
    """Under the longer name that it has among photographs of two folders."""
    return dataclasses.replace(view, name=f"left/{view.name}")


@pytest.fixture(scope="module")
def corners():
    return corner_set(8, squeeze=0.15)


@pytest.fixture(scope="module")
def calibration(corners):
    return joint(corners)


@pytest.mark.parametrize("changed", [rounded, found_again, in_a_folder])
def test_a_camera_s_own_photographs_are_no_unseen_ones(corners, calibration, changed):
    again = corners.with_views(map(changed, corners.views))
    evaluation = evaluate(calibration, again)
    assert evaluation.known == {view.name for view in again.views}
    assert evaluation.in_sample
    assert not evaluation.unseen
    assert evaluation.heldout_px is None  # nothing was calibrated again, and the camera itself has seen all of them
    opencv = evaluation.opencv["opencv5"]
    assert opencv.heldout_px != pytest.approx(opencv.insample_px, rel=1e-3)  # trained on half of the boards


def test_other_photographs_of_the_same_names_are_unseen(calibration):
    others = corner_set(8, squeeze=0.15, seed=5)
    evaluation = evaluate(calibration, others.with_views(others.views[1:]), compare_opencv=False)
    assert evaluation.unseen
    assert not evaluation.in_sample
    assert evaluation.heldout_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.15)


def test_where_some_are_known_no_board_that_trained_is_scored(corners, calibration):
    new = corner_set(8, squeeze=0.15, seed=5).views[1:]
    mixed = corners.with_views([*corners.views, *(dataclasses.replace(v, name=f"new-{v.name}") for v in new)])
    trained = []

    def again(part, name):
        trained.extend(view.name for view in part.views)
        return joint(part, name)

    evaluation = evaluate(calibration, mixed, recalibrate=again, compare_opencv=False)
    assert evaluation.known == {view.name for view in corners.views}
    assert not evaluation.unseen
    assert not evaluation.in_sample
    assert len(set(trained)) == 8
    assert evaluation.heldout_px == pytest.approx(0.1 * np.sqrt(2.0), rel=0.15)


def test_corners_that_were_wrong_are_wrong_in_a_table_too_but_not_where_they_were_found_right(corners):
    spoilt = [dataclasses.replace(v, uv=v.uv + 30.0 * (v.ids == i)[:, None]) for i, v in enumerate(corners.views)]
    calibration = joint(corners.with_views(spoilt))
    assert calibration.details["wrong_corners"] == {view.name: [i] for i, view in enumerate(corners.views)}
    assert wrong_corners(calibration, corners.with_views(map(rounded, spoilt))).count == len(spoilt)
    assert wrong_corners(calibration, corners).count == 0


def test_which_corners_are_of_one_photograph():
    assert same_photograph(VIEW, found_again(VIEW))
    assert same_photograph(VIEW, VIEW.select(VIEW.ids < 20))
    assert same_photograph(in_a_folder(VIEW), VIEW)
    assert not same_photograph(VIEW, dataclasses.replace(VIEW, name="other.png"))
    assert not same_photograph(VIEW, dataclasses.replace(VIEW, uv=VIEW.uv + 1.0))
    assert not same_photograph(VIEW.select(VIEW.ids < 20), VIEW.select(VIEW.ids >= 20))
    assert not same_photograph(not_found(VIEW.name, "dark"), not_found(VIEW.name, "dark"))
