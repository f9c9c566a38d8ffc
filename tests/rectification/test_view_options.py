"""The options by which commands are told of a view."""

from __future__ import annotations

import re

import click
import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from pinholify.cli.options import explained
from pinholify.cli.undistort_command import command
from pinholify.cli.view_options import FLAT_VIEWS, turn
from pinholify.io.camera_file import read_camera, write_camera
from pinholify.io.images import read_image, write_image
from pinholify.rectification import views
from pinholify.rectification.maps import rectification_map
from pinholify.rectification.options import KEPT, METHODS, VIEWS, ViewOptions
from pinholify.rectification.surfaces import SURFACES, FlatSurface
from pinholify.rectification.valid_region import source_mask
from synthetic import SIZE


def test_flat_views_are_those_on_a_plane():
    flat = {name for name, kind in VIEWS.items() if isinstance(SURFACES[kind.surface], FlatSurface)}
    assert flat == set(FLAT_VIEWS)


def test_help_explains_every_name():
    text = re.sub(r"\s", "", CliRunner().invoke(command, ["--help"]).output)
    assert all(name in text for name in (*VIEWS, *KEPT, *METHODS))
    assert explained({"a": "one", "b": "two", "c": "two"}) == "a: one; b, c: two."


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("30,-10,5.5", (30.0, -10.0, 5.5)), ("90", (90.0, 0.0, 0.0)), (" -1 , +.5 ", (-1.0, 0.5, 0.0))],
)
def test_turns_are_read(text, degrees):
    assert turn(text) == degrees


@pytest.mark.parametrize("text", ["", "left", "1;2", "1,2,3,4", "nan", "1,,2", "1e3"])
def test_what_is_no_turn_is_refused(text):
    with pytest.raises(click.BadParameter, match=r"write YAW\[,PITCH\[,ROLL\]\] in degrees"):
        turn(text)


@pytest.fixture(scope="module")
def files(barrel_calibration, tmp_path_factory):
    folder = tmp_path_factory.mktemp("views")
    write_camera(folder / "camera.npz", barrel_calibration)
    write_image(folder / "white.png", np.full((SIZE[1], SIZE[0]), 255, np.uint8))
    return folder


def straightened(files, out, *options):
    """The picture, or the sentence of the refusal."""
    given = [str(files / "camera.npz"), str(files / "white.png"), "-o", str(out), *options]
    result = CliRunner().invoke(command, given)
    return read_image(out / "white.png") if result.exit_code == 0 else str(result.exception)


def test_pictures_without_black(files, tmp_path):
    assert (straightened(files, tmp_path / "all", "--size", "480x300") == 0).mean() > 0.01
    assert (straightened(files, tmp_path / "valid", "--size", "480x300", "--keep", "valid") > 0).all()


def test_the_face_of_a_cube_and_a_picture_all_around(files, tmp_path):
    face = straightened(files, tmp_path / "face", "--view", "cube-front", "--size", "200x200", "--turn", "10,0,0")
    assert face.shape == (200, 200)
    whole = ["--view", "equirectangular", "--fov", "360", "--size", "400x200"]
    around = straightened(files, tmp_path / "around", *whole)
    assert 0.02 < (around > 0).mean() < 0.2
    turned = straightened(files, tmp_path / "turned", *whole, "--turn", "90,0,0")
    apart = np.abs(np.roll(around, -100, axis=1).astype(int) - turned) > 0
    assert apart.mean() < 0.001


def test_a_width_and_what_to_keep_are_one_too_many(files, tmp_path):
    assert "cannot both be given" in straightened(files, tmp_path, "--fov", "60", "--keep", "valid")


def said(files, folder, *options):
    given = [str(files / "camera.npz"), str(files / "white.png"), "-o", str(folder / "".join(options)), *options]
    result = CliRunner().invoke(command, given)
    assert result.exit_code == 0
    return result.stderr


def test_a_black_face_of_a_cube_is_said(files, tmp_path):
    assert "sees nothing of this view" in said(files, tmp_path, "--view", "cube-back")
    assert said(files, tmp_path, "--view", "cube-front") == ""


@pytest.mark.parametrize("options", [("--fov", "40", "--turn", "180"), ("--turn", "150"), ("--turn", "180,0,0")])
def test_any_other_view_of_nothing_is_refused(files, tmp_path, options):
    assert "looks away from everything the camera sees" in straightened(files, tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


def test_what_a_fitted_view_leaves_out_is_said(files, tmp_path):
    for options in ((), ("--keep", "valid"), ("--fov", "40")):
        assert said(files, tmp_path, *options) == ""
    note = said(files, tmp_path, "--turn", "50")
    turned = re.fullmatch(r"note: (.*) % of the known part of the photograph .*\n", note)
    camera = read_camera(files / "camera.npz").camera
    view = views.named_view(camera, ViewOptions(turn=(50.0, 0.0, 0.0)))
    shown = np.zeros((SIZE[1], SIZE[0]), bool)
    u, v = np.rint(np.moveaxis(rectification_map(camera, view).uv, -1, 0)).astype(int).reshape(2, -1)
    within = (u >= 0) & (v >= 0) & (u < SIZE[0]) & (v < SIZE[1])
    shown[v[within], u[within]] = True
    # The photograph magnified leaves gaps, so holes are closed.
    shown = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((7, 7))).astype(bool)
    known = source_mask(camera, None)
    assert float(turned[1]) == pytest.approx(100 * (known & ~shown).sum() / known.sum(), abs=1.0)
