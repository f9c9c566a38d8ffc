"""The whole reproduction, tiny: everything is written, the numbers are evaluation's, and photographs are kept."""

import json
import re

import cv2
import numpy as np
import pytest

from pinholify.evaluation.summary import evaluate
from pinholify.io.camera_file import read_camera
from pinholify.io.corner_tables import read_corner_table
from pinholify.reproduction.drawing import pinhole_drawing
from pinholify.reproduction.findings import findings
from pinholify.reproduction.photographs import photograph_files, rendered_before
from pinholify.reproduction.tables import all_tables, errors

pytestmark = pytest.mark.slow


def test_everything_is_written_and_nothing_else(reproduction, folder):
    files = (p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    written = {p.as_posix() for p in files if p.parts[0] != "photographs"}
    names = ("unity-barrel", "mirror")
    assert written == {
        "index.html",
        "report.md",
        "numbers.json",
        "figures/data-sets.png",
        "figures/pinholeness.png",
        *(f"corners/{name}.vnl" for name in names),
        *(f"cameras/{name}-{trend}.npz" for name in names for trend in ("constant-mean", "default-trend")),
    }
    assert reproduction.page == folder / "index.html"


def test_numbers_are_those_of_evaluation_on_the_written_files(reproduction, folder, datasets):
    numbers = json.loads((folder / "numbers.json").read_text())
    assert numbers == json.loads(json.dumps(reproduction.numbers))
    for dataset in datasets:
        table = folder / "corners" / f"{dataset.name}.vnl"
        corners = read_corner_table(table, board=dataset.board, image_size=dataset.lens.size)
        for name, key in (("constant-mean", "constant_mean"), ("default-trend", "default_trend")):
            camera = read_camera(folder / "cameras" / f"{dataset.name}-{name}.npz")
            pooled = evaluate(camera, corners, compare_opencv=False).pooled
            said = numbers["data_sets"][dataset.name][key]["pooled"]
            assert said["ce"] == pytest.approx(pooled.ce, rel=1e-4)
            assert said["re_percent"] == pytest.approx(pooled.re_percent, rel=1e-4)


def test_table_2_shows_the_papers_figures_beside_evaluations(reproduction):
    barrel, mirror = errors(reproduction.results).rows
    assert barrel[:4] == ("Unity barrel", "1.334", "0.1410", "1.0315")
    assert mirror[:4] == ("RealSense with mirror", "9.455", "0.4404", "0.5376")
    paper, ours = (attempt.evaluation for attempt in (reproduction.results[0].paper, reproduction.results[0].ours))
    assert paper.calibration.trend == "constant"
    assert ours.calibration.trend.startswith("lens")
    assert float(barrel[4]) == pytest.approx(paper.pooled.ce * 1e4, abs=5e-4)
    assert float(barrel[8]) == pytest.approx(ours.pooled.re_percent, abs=5e-5)
    assert float(barrel[10]) == pytest.approx(ours.opencv["opencv5"].re_percent, abs=5e-5)


def test_what_was_rendered_is_found_again(reproduction):
    barrel, mirror = reproduction.results
    for result in (barrel, mirror):
        assert len(result.corner_set.found) == 6
        assert result.corner_errors.rms_px < 0.06
        assert max(map(abs, result.corner_errors.shift_px)) < 0.01
    assert barrel.ours.truth.map_px < 0.03
    assert max(map(abs, barrel.ours.truth.intrinsics_error)) < 0.01
    assert barrel.ours.truth.refined.turn_degrees < 0.05
    assert barrel.ours.truth.refined.middle_squares < 0.01
    assert mirror.ours.truth.intrinsics is None
    assert mirror.ours.truth.map_px < 0.1


def test_the_true_lens_bounds_the_held_out_error(reproduction):
    barrel, mirror = reproduction.results
    assert barrel.heldout_floor_px <= 1.02 * barrel.ours.evaluation.heldout_px
    assert barrel.heldout_floor_px < 0.06
    assert mirror.heldout_floor_px < 0.06 < mirror.ours.evaluation.heldout_px


def test_exact_corners_leave_an_error_only_where_rays_do_not_meet(reproduction):
    barrel, mirror = reproduction.results
    assert barrel.exact.re_percent < 0.05
    assert mirror.exact.re_percent > 1.0


def test_findings_say_where_ours_differ(reproduction):
    said = {finding.claim: finding for finding in findings(reproduction.results)}
    assert not next(f for claim, f in said.items() if "perfect pinhole camera" in claim).agrees
    assert next(f for claim, f in said.items() if "better than MATLAB by 7.3" in claim).agrees
    page = reproduction.page.read_text()
    for finding in said.values():
        assert f"{finding.claim}: {'agrees' if finding.agrees else 'differs'}." in page.replace("&#x27;", "'")


def test_the_page_stands_alone_and_shows_every_table(reproduction, folder):
    page, markdown = reproduction.page.read_text(), (folder / "report.md").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert "://" not in page  # a colon is in no data: letters alone might be
    for table in all_tables(reproduction.results):
        assert table.title in page
        for row in table.rows:
            assert len(row) == len(table.header)
            assert "| " + " | ".join(row) + " |" in markdown
    for place in re.findall(r"\]\((.*)\)", markdown):
        assert (folder / place).is_file()


def test_lines_of_sight_in_the_page_pass_near_the_origin(reproduction):
    page = reproduction.page.read_text()
    barrel, mirror = json.loads(re.search(r'id="pinhole-lines">(.*?)</script>', page)[1])
    for panel, farthest in ((barrel, 0.01), (mirror, 0.5)):
        segments = np.array(panel["segments"])
        assert 80 <= len(segments) <= 100
        direction = segments[:, 1] - segments[:, 0]
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        assert np.linalg.norm(np.cross(segments[:, 0], direction), axis=1).max() < farthest
        assert (segments[:, 0, 2] < 0).all()
        assert (segments[:, 1, 2] > 0.5).all()


def test_drawn_lines_are_the_measured_ones(reproduction):
    evaluation = reproduction.results[0].paper.evaluation
    f = evaluation.calibration.camera.intrinsics.f
    drawing = pinhole_drawing(evaluation.lines, f)
    start, direction = drawing.segments[:, 0], np.diff(drawing.segments, axis=1)[:, 0]
    distances = np.linalg.norm(np.cross(start, direction), axis=1) / np.linalg.norm(direction, axis=1)
    np.testing.assert_allclose(distances, evaluation.lines.distances, rtol=1e-6, atol=1e-12)
    share = -start[:, 2] / direction[:, 2]
    np.testing.assert_allclose((start + share[:, None] * direction)[:, :2], drawing.crossings, atol=1e-12)


def test_figures_are_fit_for_print(reproduction, folder):
    for name, width in (("data-sets.png", 2400), ("pinholeness.png", 2000)):
        picture = cv2.imread(str(folder / "figures" / name))
        assert picture.shape[1] >= width
        assert picture.std() > 20


def test_finished_photographs_are_taken_up_again_and_unfinished_ones_are_not(reproduction, folder, datasets):
    dataset = datasets[0]
    files = photograph_files(dataset, 6, folder / "photographs")
    assert rendered_before(dataset, files)
    assert not rendered_before(datasets[1], files)
    assert not rendered_before(dataset, photograph_files(dataset, 7, folder / "photographs"))
