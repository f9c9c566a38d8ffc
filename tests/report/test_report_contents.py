"""What a report says is true: against the simulated camera, analytic shapes, and the evaluation."""

import dataclasses
import hashlib
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinholify.cli.evaluation_output import print_evaluation
from pinholify.evaluation.summary import evaluate
from pinholify.evaluation.verdict import judge
from pinholify.geometry import ConvexRegion, convex_hull
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.views import named_view
from pinholify.refinement.sharing import SharedError
from pinholify.report.contents import make_report
from pinholify.report.contours import grid_pixels, region_inside, regions_above
from pinholify.report.formats.html import render
from pinholify.report.html.scene import reach, turned
from pinholify.report.narrative import facts, sections
from pinholify.report.numerals import round_down
from pinholify.report.pictures import ruler_ends, thumbnail_width
from pinholify.simulation.views import virtual_camera
from small_camera import BOARD, LENS, SIZE


def area(polygons):
    """Enclosed area by the even-odd rule, px²: a hole, traced the other way round, counts negative."""
    total = 0.0
    for polygon in polygons:
        x, y = polygon.T
        total += (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    return abs(total)


def test_the_intervals_hold_the_true_camera(report, poses):
    for length, true in zip(report.intrinsics.lengths, virtual_camera(poses[0]), strict=True):
        low, high = length.interval
        assert abs(length.value - true) < 4 * length.std, length.name
        assert low < length.value < high
        assert high - low == pytest.approx(2 * 1.96 * length.std)
        assert high - low < 0.05 * true


def test_the_field_of_view_is_the_lenss(report):
    right, bottom = SIZE[0] - 1.0, SIZE[1] - 1.0
    ends = np.array([[0, bottom / 2], [right, bottom / 2], [right / 2, 0], [right / 2, bottom]])
    rays = LENS.unproject(ends)[1]
    cosines = np.einsum("ni,ni->n", rays[::2], rays[1::2])
    assert report.intrinsics.field_of_view[:2] == pytest.approx(np.degrees(np.arccos(cosines)), rel=0.01)


def test_boards_stand_where_they_stood(report, poses):
    middle = np.array([[(BOARD.columns - 1) / 2, (BOARD.rows - 1) / 2]])
    for entry, pose in zip(report.boards, poses, strict=False):
        if entry.distance is None:
            continue
        centre = pose.apply(middle)[0]
        assert entry.distance == pytest.approx(np.linalg.norm(centre), rel=0.01)
        tilt = np.degrees(np.arccos(abs(pose.rotation[:, 2] @ centre) / np.linalg.norm(centre)))
        assert entry.tilt_degrees == pytest.approx(tilt, abs=1.0)
    assert sum(entry.distance is not None for entry in report.boards) >= 5


def test_residuals_are_as_large_as_the_noise(report, noise):
    counted = [entry for entry in report.boards if entry.counted.any()]
    assert report.residuals.rms_px == pytest.approx(noise * np.sqrt(2), rel=0.2)
    pooled = np.concatenate([entry.residuals[entry.counted] for entry in counted])
    assert np.isfinite(pooled).all()
    assert report.residuals.rms_px == pytest.approx(np.sqrt((pooled**2).sum(axis=1).mean()))
    for entry in counted:
        lengths = np.linalg.norm(entry.residuals[entry.counted], axis=1)
        assert entry.rms_px == pytest.approx(np.sqrt((lengths**2).mean()))
        assert entry.worst_px == lengths.max()


def test_means_over_cells_are_means_of_the_residuals(report):
    field = report.residuals
    uv = np.concatenate([entry.corners[entry.counted] for entry in report.boards])
    cell = max(SIZE) / 16
    for centre, mean in zip(field.centres, field.means, strict=True):
        inside = (np.abs(uv - centre) <= cell / 2).all(axis=1)
        assert inside.sum() >= 3
        assert mean == pytest.approx(field.all[inside].mean(axis=0), abs=1e-12)
    assert field.magnification * np.linalg.norm(field.means, axis=1).max() <= cell


def test_an_image_without_a_board_is_left_out_and_says_why(report):
    street = report.boards[-1]
    assert (street.name, street.included, street.reason) == ("street.png", False, "no board found")
    assert street.rms_px is None
    assert len(street.corners) == 0


def test_left_out_boards_say_why(report):
    out = [entry for entry in report.boards if not entry.included]
    assert all(entry.reason for entry in out)
    assert report.overview.boards_used == sum(entry.included for entry in report.boards)


def test_the_board_dropped_by_the_fit_is_left_out_though_it_is_scored(evaluation, verdict, report):
    used = next(entry.name for entry in report.boards if entry.included)
    details = {"dropped_boards": {used: "it was moved"}}
    calibration = dataclasses.replace(evaluation.calibration, details=details)
    told = make_report(dataclasses.replace(evaluation, calibration=calibration), verdict, report.provenance)
    entries = {entry.name: entry for entry in told.boards}
    assert not entries[used].included
    assert entries[used].reason == "it was moved"


def test_wrong_corners_are_counted_drawn_and_in_no_number(evaluation, corners, report, hostile):
    details = {"wrong_corners": {hostile: [3, 7], "a0.png": list(range(10))}}
    calibration = dataclasses.replace(evaluation.calibration, details=details)
    freed = evaluate(calibration, corners, compare_opencv=False)
    told = make_report(freed, judge(freed, corners), report.provenance)
    entry = next(entry for entry in told.boards if entry.name == hostile)
    assert np.flatnonzero(entry.wrong).tolist() == [3, 7]
    assert entry.dropped == 2
    assert not entry.counted[[3, 7]].any()
    assert np.isnan(entry.residuals[[3, 7]]).all()
    before = next(entry for entry in report.boards if entry.name == hostile)
    assert entry.counted.sum() == before.counted.sum() - 2
    assert [entry.name for entry in told.boards if entry.crowded] == ["a0.png"]
    assert render(told).count("too many wrong corners</span>") == 1
    assert ("Wrong corners", f"12 of {9 * 54}", "left out of every number") in facts(told)
    assert any("12 of 486 corners are wrong" in text for part in sections(told) for text in part.paragraphs)
    assert render(told).count('class="misplaced') == 2 * len(told.boards)
    assert len(re.findall(r'd="[^"]+" class="misplaced', render(told))) == 2 * 2
    assert all(label != "Wrong corners" for label, *_ in facts(report))


def test_lines_are_straighter_than_in_the_photographs(report):
    lines = report.straightness
    assert lines.example == "a0.png"
    assert lines.ce < lines.image_ce / 5
    bends = [
        max(float(np.abs(bent - straight).max()) for straight, bent in zip(b.straight, b.bent, strict=True))
        for b in (lines.before, lines.after)
    ]
    assert bends[1] < bends[0] / 5
    assert bends[0] <= 0.06 * 1.0001


def test_lines_of_sight_pass_the_centre(report):
    scene = report.scene
    assert len(scene.lines) == len(scene.crossings) > 50
    assert np.linalg.norm(scene.crossings, axis=1).mean() == pytest.approx(scene.pinholeness, rel=0.5)
    along = scene.lines[:, 1] - scene.lines[:, 0]
    distances = np.linalg.norm(np.cross(scene.lines[:, 0], along), axis=1) / np.linalg.norm(along, axis=1)
    assert distances.mean() / report.intrinsics.lengths[0].value == pytest.approx(scene.pinholeness, rel=1e-6)
    assert (scene.lines[:, 1, 2] > 0).all()


def test_the_scene_is_seen_whole_and_undistorted(report):
    points = np.concatenate([report.scene.boards.reshape(-1, 3), report.scene.frustum])
    flat, depth = turned(points)
    between = np.linalg.norm(points[:, None] - points[None], axis=2)
    seen = np.hypot(np.linalg.norm(flat[:, None] - flat[None], axis=2), depth[:, None] - depth[None])
    assert seen == pytest.approx(between, abs=1e-9)
    assert (np.ptp(flat, axis=0) <= 2 * reach(report.scene) + 1e-9).all()


def test_contours_enclose_what_they_should():
    size = (640, 480)
    distance = np.linalg.norm(grid_pixels(size) - [300.0, 250.0], axis=1)
    outer, inner = regions_above(-distance, (-150.0, -50.0), size)
    assert area(outer) == pytest.approx(np.pi * 150**2, rel=0.03)
    assert area(inner) == pytest.approx(np.pi * 50**2, rel=0.05)
    ring = regions_above(-np.abs(distance - 100.0), (-50.0,), size)[0]
    assert len(ring) == 2
    assert area(ring) == pytest.approx(np.pi * (150**2 - 50**2), rel=0.05)


def test_the_believed_region_is_the_hull_cut_by_the_limit():
    size = (640, 480)
    hull = ConvexRegion(np.array([[100.0, 100.0], [500.0, 100.0], [500.0, 400.0], [100.0, 400.0]]))
    u = grid_pixels(size)[:, 0]
    assert area(region_inside(hull, u, 300.0, size)) == pytest.approx(200 * 300, rel=0.02)
    assert area(region_inside(hull, u, np.inf, size)) == pytest.approx(400 * 300, rel=0.02)


def test_coverage_is_what_its_outline_encloses(report):
    assert area(report.coverage.believed) / np.prod(SIZE) == pytest.approx(report.coverage.share, abs=0.02)
    assert report.overview.coverage == report.coverage.share


def coverage_text(report):
    return next(section.paragraphs[0] for section in sections(report) if section.key == "coverage")


def test_what_pictures_show_is_said(report, evaluation):
    """Of a camera of one image its domain; of one whose std has a limit all that is known as well, and how well."""
    camera = evaluation.calibration.camera
    seen = rectification_map(camera, named_view(camera, ViewOptions(size=(1600, 1200))))
    u, v = np.rint(seen.uv[seen.valid]).astype(int).T
    pixels = len(np.unique(v * SIZE[0] + u))
    assert report.coverage.shown == pytest.approx(pixels / np.prod(SIZE), abs=0.01)
    assert report.coverage.shown == pytest.approx(report.coverage.share, abs=0.01)
    assert "'pinholify undistort' shows the domain and leaves the rest black" in coverage_text(report)
    limited = dataclasses.replace(report.coverage, shown=0.873, limit_px=0.482)
    text = coverage_text(dataclasses.replace(report, coverage=limited))
    assert "shows the 87 % of the image where the map is known to 0.48 px" in text


def test_levels_lie_in_one_another_and_reach_the_whole_image(report):
    areas = [area(region) for region in report.certainty.regions]
    assert areas == sorted(areas, reverse=True)
    assert report.certainty.inside_px <= report.certainty.image_px


def test_the_ruler_lies_on_the_straightened_boards_edges(report, evaluation):
    frame = report.frames[0]
    assert frame.name == "a0.png"
    view = evaluation.calibration.corner_set.views[0]
    ends = ruler_ends(view, BOARD)
    assert ends.shape == (4, 2, 2)
    ids = {0, BOARD.columns - 1, BOARD.columns * (BOARD.rows - 1), BOARD.columns * BOARD.rows - 1}
    assert {tuple(end) for end in ends.reshape(-1, 2)} == {tuple(view.uv[i]) for i in ids}
    # Of a pinhole camera, the middle corner of an edge lies on the ruler; in the photograph it does not.
    camera = evaluation.calibration.camera
    row = np.arange(BOARD.columns)
    straight = named_view(camera).project(camera.to_rays(view.uv[row]).directions)
    assert bend(straight) < 0.2
    assert bend(view.uv[row]) > 1.0
    assert frame.ruler_after[0] * SIZE - 0.5 == pytest.approx(straight[[0, -1]], abs=0.01)


def bend(points):
    """Largest distance of points from the line through the first and the last, px."""
    along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    offset = points - points[0]
    return np.abs(offset[:, 0] * along[1] - offset[:, 1] * along[0]).max()


def test_frames_are_the_reference_and_what_shows_no_board(report):
    assert [frame.name for frame in report.frames] == ["a0.png", "street.png"]
    assert report.frames[1].ruler_before.shape == (0, 2, 2)


def test_provenance_is_the_files(report, camera_file):
    assert report.provenance.sha256 == hashlib.sha256(camera_file.read_bytes()).hexdigest()
    assert report.provenance.software.startswith("pinholify ")
    assert report.provenance.created.endswith("+00:00")


def test_what_is_missing_is_said(report, bare_report):
    assert not any("photograph" in sentence for sentence in report.missing)
    assert "photographs were not available" in bare_report.missing[0]
    assert "--no-heldout" in bare_report.missing[1]
    assert not bare_report.frames


def test_comparison_counts_all_corners_alike(report, evaluation):
    assert report.comparison.insample_px == report.overview.insample_px == report.residuals.rms_px
    assert report.comparison.models == evaluation.opencv
    assert set(report.comparison.models) == {"opencv5", "opencv8", "fisheye"}


def test_hulls_of_counted_boards(report):
    counted = [entry for entry in report.boards if entry.counted.any()]
    assert len(report.coverage.boards) == len(counted)
    for outline, entry in zip(report.coverage.boards, counted, strict=True):
        assert area([outline]) == pytest.approx(convex_hull(entry.corners[entry.counted]).area)


@given(st.floats(1e-6, 1e9))
def test_round_down_is_the_next_round_number_below(value):
    rounded = round_down(value)
    assert rounded <= value * (1 + 1e-9) < 2.5 * rounded * (1 + 1e-9)
    assert float(f"{rounded:.6e}"[0]) in (1, 2, 5)


@given(st.integers(0, 10_000))
def test_many_photographs_get_small_thumbnails(count):
    width = thumbnail_width(count)
    assert 160 <= width <= 480
    assert width == 160 or count * width**2 <= 46 * 480**2


def paragraphs(report, key):
    return " ".join(next(part for part in sections(report) if part.key == key).paragraphs)


def test_what_boards_disagree_on_and_what_they_share_is_told(evaluation, verdict, report):
    assert "disagree" not in paragraphs(report, "intrinsics")
    assert "is the board flat" not in paragraphs(report, "residuals")
    calibration = dataclasses.replace(evaluation.calibration, details={"disagreement": 3.9})
    bent = dataclasses.replace(verdict, shared=SharedError(0.12, 1e-9))
    told = make_report(dataclasses.replace(evaluation, calibration=calibration), bent, report.provenance)
    assert "The boards disagree 3.9 times as much as corner noise explains" in paragraphs(told, "intrinsics")
    assert "0.12 px is the same at each corner of the board" in paragraphs(told, "residuals")
    assert "(p < 0.0001): is the board flat" in paragraphs(told, "residuals")


def test_whose_board_is_flat_is_told_where_it_matters(evaluation, verdict, report, capsys):
    details = {"board_bow_squares": 0.02, "board_stretch": 0.004}
    bent = dataclasses.replace(
        evaluation, calibration=dataclasses.replace(evaluation.calibration, details=details)
    )
    alone = dataclasses.replace(bent, opencv={})
    for scored, said in ((evaluation, False), (alone, False), (bent, True)):
        print_evaluation(scored, verdict)
        assert ("OpenCV's models with a flat board" in capsys.readouterr().out) is said
        told = make_report(scored, verdict, report.provenance)
        assert ("OpenCV's models with a flat board" in paragraphs(told, "comparison")) is said
