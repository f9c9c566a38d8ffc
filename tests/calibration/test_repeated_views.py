"""A photograph given twice tells nothing twice, and is named."""

import dataclasses

import numpy as np
import pytest

from pinholify.corners import not_found, repeated
from pinholify.errors import CalibrationError
from pinholify.evaluation.summary import evaluate
from pinholify.pipeline import calibrate
from synthetic import corner_set

CORNERS = corner_set(9, squeeze=0.15)
METHODS = [{"method": "joint", "trend": "plane:1"}, {"method": "one-image", "trend": "lens:1"}]


def copies(views, prefix):
    """The same corners under other names, in another order."""
    return [
        dataclasses.replace(v, name=prefix + v.name, ids=v.ids[::-1], uv=v.uv[::-1], weights=v.weights[::-1])
        for v in views
    ]


def test_views_that_repeat_another_are_named_with_it():
    first, second, third = CORNERS.views[:3]
    moved = dataclasses.replace(first, name="moved", uv=first.uv + 1e-4)
    fewer = dataclasses.replace(first.select(first.ids > 0), name="fewer")
    renumbered = dataclasses.replace(first, name="renumbered", ids=first.ids[::-1])
    others = [moved, fewer, renumbered, not_found("a", ""), not_found("b", "")]
    views = [first, second, *copies([first], "x"), *copies([second], "y"), *copies([first], "z"), third, *others]
    assert repeated(views) == {
        "x" + first.name: first.name, "y" + second.name: second.name, "z" + first.name: first.name
    }


@pytest.mark.parametrize("options", METHODS, ids=["joint", "one image"])
@pytest.mark.parametrize("times", [1, 3])
def test_all_photographs_given_again_are_no_more_photographs(options, times):
    again = [view for i in range(times) for view in copies(CORNERS.views, f"again{i}-")]
    twice = CORNERS.with_views([*CORNERS.views, *again])
    one = calibrate(CORNERS, reference="view0.png", **options)
    other = calibrate(twice, reference="view0.png", **options)
    np.testing.assert_allclose(other.intrinsics_std, one.intrinsics_std, rtol=1e-6)
    assert other.camera.intrinsics.f == pytest.approx(one.camera.intrinsics.f, rel=1e-9)
    evaluation = evaluate(other, twice, compare_opencv=False)
    reasons = {board.file: board.reason for board in evaluation.boards if not board.used}
    assert reasons == {view.name: f"it has the same corners as {view.name.partition('-')[2]}" for view in again}


@pytest.mark.parametrize("options", METHODS, ids=["joint", "one image"])
def test_one_photograph_given_often_does_not_outweigh_the_others(options):
    often = CORNERS.with_views([*CORNERS.views, *(c for i in range(12) for c in copies(CORNERS.views[3:4], f"{i}-"))])
    one, other = (calibrate(corners, reference="view0.png", **options) for corners in (CORNERS, often))
    np.testing.assert_allclose(other.intrinsics_std, one.intrinsics_std, rtol=1e-6)


def test_a_reference_that_repeats_another_photograph():
    copied = CORNERS.with_views([*copies(CORNERS.views[:1], "copy-of-"), *CORNERS.views])
    one_image, joint = METHODS[1], METHODS[0]
    calibration, alone = (calibrate(c, reference="view0.png", **one_image) for c in (copied, CORNERS))
    np.testing.assert_allclose(calibration.intrinsics_std, alone.intrinsics_std, rtol=1e-6)
    with pytest.raises(CalibrationError, match=r"it has the same corners as copy-of-view0.png\).* another reference"):
        calibrate(copied, reference="view0.png", **joint)
