"""What the figures draw: best-fit lines, deviations, lines of sight."""

import numpy as np

from pinholify.evaluation.measures import PinholeLines
from pinholify.geometry import line_distances
from pinholify.report.numerals import round_down
from pinholify.reproduction.drawing import FAR, collinearity_drawing, pinhole_drawing


def test_drawn_deviations_are_the_distances_to_the_best_fit_lines_magnified():
    lattice = np.array([[x, y] for y in range(3) for x in range(4)], dtype=float)
    points = lattice + np.random.default_rng(0).normal(0, 0.01, lattice.shape)
    drawing = collinearity_drawing(lattice, points)
    assert len(drawing.lines) == 7
    lengths = np.linalg.norm(np.diff(drawing.deviations, axis=1)[:, 0], axis=1)
    rows = np.concatenate([line_distances(points[4 * k : 4 * k + 4]) for k in range(3)])
    np.testing.assert_allclose(lengths[: len(rows)], drawing.magnification * rows, rtol=1e-9)


def test_round_down_to_one_two_five():
    assert [round_down(v) for v in (1.0, 1.99, 2.0, 4.9, 5.0, 9.9, 499.0, 0.03)] == [1, 1, 2, 2, 5, 5, 200, 0.02]


def test_a_pinholes_lines_meet_in_the_origin_and_end_at_one_depth():
    rng = np.random.default_rng(1)
    directions = np.column_stack([rng.uniform(-1, 1, (20, 2)), np.ones(20)])
    points = tuple(d * rng.uniform(5, 15, (6, 1)) for d in directions)
    anchors = np.array([p.mean(axis=0) for p in points])
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    drawing = pinhole_drawing(PinholeLines(points, anchors, unit, np.zeros(20)), f=5.0)
    np.testing.assert_allclose(drawing.crossings, 0.0, atol=1e-12)
    far = np.percentile(np.concatenate(points)[:, 2], FAR) / 5.0
    np.testing.assert_allclose(drawing.segments[:, 1], far * directions)
    assert (drawing.segments[:, 0, 2] < 0).all()


def test_lines_that_miss_the_origin_cross_where_they_pass():
    anchors, directions = np.array([[0.3, -0.2, 10.0]]), np.array([[0.0, 0.0, -1.0]])
    points = (np.array([[0.3, -0.2, z] for z in (8.0, 10.0, 12.0)]),)
    drawing = pinhole_drawing(PinholeLines(points, anchors, directions, np.array([0.36])), f=2.0)
    np.testing.assert_allclose(drawing.crossings, [[0.15, -0.1]])
