"""The picture of the board's own shape: what is drawn is what the corners do."""

import dataclasses

import numpy as np
import pytest

from pinholify.board import lattice
from pinholify.report.board_shape import board_shape_of
from pinholify.report.formats import html, json
from pinholify.report.narrative import sections
from small_camera import BOARD


def shaped(evaluation, points):
    return dataclasses.replace(evaluation.calibration, board_points=points)


@pytest.fixture
def flat():
    """The points of a perfect board."""
    return np.column_stack([lattice(BOARD), np.zeros(BOARD.columns * BOARD.rows)])


def test_a_perfect_board_has_no_shape_wherever_it_lies(evaluation, report, flat):
    turned = flat @ np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]) * 1.01 + [3.0, -1.0, 0.2]
    for points in (flat, turned):
        assert board_shape_of(shaped(evaluation, points)) is None
    assert report.board_shape is None
    assert "board-shape" not in {section.key for section in sections(report)}


def test_shifts_and_heights_are_those_of_the_corners(evaluation, flat):
    bump, shift = 20, 7
    points = np.array(flat)
    points[bump, 2] += 0.1
    points[shift, 0] += 0.01
    found = board_shape_of(shaped(evaluation, points))
    assert np.abs(found.heights).argmax() == bump
    assert found.heights[bump] == pytest.approx(0.1, rel=0.1)
    assert found.height_range == pytest.approx(np.ptp(found.heights))
    assert np.linalg.norm(found.shifts, axis=1).argmax() == shift
    np.testing.assert_allclose(found.shifts[shift], [0.01, 0.0], atol=0.002)
    assert found.magnification == 50.0


def test_the_page_draws_every_corner_and_gives_millimetres(evaluation, report, flat):
    points = flat * [1.0, 1.005, 1.0] + np.outer((flat[:, 0] - flat[:, 0].mean()) ** 2, [0.0, 0.0, 0.001])
    shape = board_shape_of(shaped(evaluation, points))
    page = dataclasses.replace(report, board_shape=shape)
    (section,) = (section for section in sections(page) if section.key == "board-shape")
    assert f"({shape.height_range * 25.0:.3f} mm)" in section.paragraphs[0]
    text = html.render(page)
    assert text.count('class="low"') + text.count('class="high"') == BOARD.columns * BOARD.rows
    assert len(json.as_object(page)["board_shape"]["heights"]) == BOARD.columns * BOARD.rows
