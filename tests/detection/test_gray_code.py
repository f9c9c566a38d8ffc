"""Gray codes: pictures to codes to nodes, against what was rendered."""

import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from pinholify.board import parse_board
from pinholify.corners import Corners
from pinholify.detection.gray_code import (
    ScreenMap,
    Sequence,
    decode_captures,
    decode_folders,
    read_manifest,
    write_patterns,
)
from pinholify.detection.gray_code.decode import without_strangers
from pinholify.detection.gray_code.nodes import fit_nodes
from pinholify.detection.gray_code.patterns import Pattern, gray_code
from pinholify.detection.gray_code.screen_map import decode, shift_between
from pinholify.errors import BoardError, ImageError, InputError
from pinholify.io.images import write_image
from pinholify.simulation.photograph import Sensor
from pinholify.simulation.views import true_corners
from screen_scene import LENS, SCREEN, SEQUENCE, captures, screen_poses

POSE = screen_poses(2)[1]


def as_light(images):
    return [image.astype(np.float32) / 255 for image in images]


@pytest.fixture(scope="module")
def seen():
    """Captures of one tilted pose."""
    return captures(POSE)


@given(st.integers(0, 2**15 - 2))
def test_neighbours_differ_in_one_bit(number):
    pair = np.array([number, number + 1])
    assert bin(np.bitwise_xor.reduce(gray_code(pair))).count("1") == 1


@pytest.mark.parametrize("sequence", [Sequence((100, 70)), Sequence((100, 70), 4, 16), Sequence((320, 192), 8, 32)])
def test_a_camera_that_sees_screen_pixels_one_to_one_reads_their_numbers(sequence):
    pictures = [(sequence.picture(pattern) / np.float32(255)) for pattern in sequence.patterns]
    found = decode(pictures, sequence, "here")
    x, y = np.meshgrid(np.arange(sequence.size[0]), np.arange(sequence.size[1]))
    # Gray codes alone: the border of the finest stripes is sharp here, so every number is exact.
    np.testing.assert_allclose(found.x, x, atol=0.02 if sequence.steps else 0)
    np.testing.assert_allclose(found.y, y, atol=0.02 if sequence.steps else 0)


def test_a_gamma_moves_no_wave_of_eight_steps():
    sequence = Sequence((320, 192), 8, 32)
    pictures = [(sequence.picture(pattern) / np.float32(255)) ** np.float32(2.2) for pattern in sequence.patterns]
    found = decode(pictures, sequence, "here")
    np.testing.assert_allclose(found.x, np.broadcast_to(np.arange(320), (192, 320)), atol=0.02)


def test_stripes_too_fine_to_see_leave_the_middle_of_the_finest_that_is_seen():
    sequence = Sequence((64, 64))
    pictures = []
    for pattern in sequence.patterns:
        faint = pattern.kind in ("bit", "inverse") and pattern.index == 0
        picture = sequence.picture(pattern) / np.float32(255)
        pictures.append(np.full_like(picture, 0.5) if faint else picture)
    found = decode(pictures, sequence, "here")
    np.testing.assert_array_equal(found.x[0], np.arange(64) // 2 * 2 + 0.5)


@pytest.mark.parametrize(("steps", "rms"), [(8, 0.04), (0, 0.15)])
def test_nodes_are_where_the_lens_images_them(steps, rms):
    sequence = Sequence((320, 192), steps)
    found = decode_captures(as_light(captures(POSE, sequence)), sequence)
    view = found.corners.views[0]
    error = view.uv - true_corners(LENS, SCREEN, POSE)[view.ids]
    assert len(view) > 0.9 * SCREEN.columns * SCREEN.rows
    assert np.sqrt((error**2).mean()) < rms
    assert np.abs(error.mean(axis=0)).max() < rms / 3
    whitened = error * view.weights[:, None] / found.std_px
    assert 0.5 < np.sqrt((whitened**2).mean()) < 3.0


def test_what_a_hand_hides_is_left_out_and_the_rest_stays(seen):
    hidden = [image.copy() for image in seen]
    for image in hidden:
        image[90:150, 120:190] = 90
    view = decode_captures(as_light(hidden), SEQUENCE).corners.views[0]
    truth = true_corners(LENS, SCREEN, POSE)
    u, v = truth.T
    under = (u > 122) & (u < 188) & (v > 92) & (v < 148)
    clear = (u < 112) | (u > 198) | (v < 82) | (v > 158)
    assert not np.isin(np.flatnonzero(under), view.ids).any()
    assert np.isin(np.flatnonzero(clear), view.ids).mean() > 0.9
    assert np.abs(view.uv - truth[view.ids]).max() < 0.5


def test_pixels_of_wrong_codes_do_not_move_nodes(seen):
    rng = np.random.default_rng(0)
    spoilt = [image.copy() for image in seen]
    bad = rng.uniform(size=seen[0].shape) < 0.05
    for i, image in enumerate(spoilt[3:-1]):
        image[bad] = np.random.default_rng(i).integers(0, 255, bad.sum())
    view = decode_captures(as_light(spoilt), SEQUENCE).corners.views[0]
    error = view.uv - true_corners(LENS, SCREEN, POSE)[view.ids]
    assert len(view) > 0.8 * SCREEN.columns * SCREEN.rows
    assert np.sqrt((error**2).mean()) < 0.06


@pytest.mark.parametrize(("seen_to", "columns"), [(56, 3), (60, 4)])
def test_a_cell_of_which_half_is_hidden_tells_no_node(seen_to, columns):
    x, y = np.meshgrid(np.arange(96.0), np.arange(96.0))
    hidden = x >= seen_to
    found = fit_nodes(ScreenMap(np.where(hidden, np.nan, x), np.where(hidden, np.nan, y)), parse_board("gray:96x96:16"))
    np.testing.assert_array_equal(np.unique(found.ids % 6), np.arange(columns))
    np.testing.assert_allclose(found.uv[:, 0], found.ids % 6 * 16 + 7.5, atol=1e-6)


def test_a_node_elsewhere_than_its_neighbours_say_is_taken_out_alone():
    ids = np.arange(SCREEN.columns * SCREEN.rows)
    uv = true_corners(LENS, SCREEN, POSE) + np.random.default_rng(0).normal(0, 0.02, (len(ids), 2))
    uv[77] += [0.0, 1.5]
    left = without_strangers(Corners("a", ids, uv), SCREEN, 0.02)
    assert set(ids) - set(left.ids) == {77}


@pytest.mark.parametrize("shift", [0.0, 0.5, 7.0])
def test_a_shift_is_seen(seen, shift):
    first = seen[0].astype(np.float32) / 255
    u = np.arange(320) - shift
    last = np.stack([np.interp(u, np.arange(320), row) for row in first]).astype(np.float32)
    found = shift_between(first, last, np.ones(first.shape, dtype=bool))
    if shift < 1:
        assert found == pytest.approx(shift, abs=0.1)
    else:
        assert found > 1


# --- files, and what can be wrong with them ---------------------------------------------------------------------


def write_captures(folder, images, names=SEQUENCE.files):
    folder.mkdir()
    for name, image in zip(names, images, strict=True):
        write_image(folder / name, image)
    return folder


def test_patterns_are_numbered_and_told_by_their_manifest(tmp_path):
    written = list(write_patterns(tmp_path / "patterns", SEQUENCE))
    assert len(written) == len(SEQUENCE.patterns) + 1
    assert sorted(path.name for path in written[:-1]) == list(SEQUENCE.files)
    assert read_manifest(tmp_path / "patterns") == SEQUENCE
    assert json.loads(written[-1].read_text())["pixel_mm"] == 0.25


def test_a_folder_of_captures_is_decoded(tmp_path, seen):
    folder = write_captures(tmp_path / "pose", seen, [f"DSC_{i:04d}.png" for i in range(len(seen))])
    maps = []
    found = decode_folders([folder], SEQUENCE, on_pose=lambda name, seen: maps.append((name, seen.x.shape)))
    assert found.corners.board == parse_board("gray:320x192:16")
    assert found.corners.image_size == (320, 240)
    assert maps == [("pose", (240, 320))]
    assert len(found.corners.views[0]) > 200


def test_a_folder_given_twice_is_told_as_a_folder(tmp_path, seen):
    folder = write_captures(tmp_path / "pose", seen)
    with pytest.raises(ImageError, match=r"the folder '.*pose' is given twice; name each folder once"):
        decode_folders([folder, folder], SEQUENCE)


def test_a_missing_capture_is_named(tmp_path, seen):
    folder = write_captures(tmp_path / "pose", seen)
    (folder / SEQUENCE.files[5]).unlink()
    with pytest.raises(ImageError, match=f"41 images where 42 .* '{SEQUENCE.files[5][:-4]}' is missing"):
        decode_folders([folder], SEQUENCE)


def test_a_wrong_number_of_captures_is_told(tmp_path, seen):
    folder = write_captures(tmp_path / "pose", [*seen, seen[0]], [f"{i:02d}.png" for i in range(len(seen) + 1)])
    with pytest.raises(ImageError, match="43 images where 42 patterns were shown: give one capture of each"):
        decode_folders([folder], SEQUENCE)


def test_captures_of_another_size_are_refused(tmp_path, seen):
    folder = write_captures(tmp_path / "pose", [*seen[:-1], seen[-1][:, :-2]])
    with pytest.raises(ImageError, match="is 318x240 and the captures before it are 320x240"):
        decode_folders([folder], SEQUENCE)


def test_a_camera_that_moved_is_told(seen):
    moved = [*seen[:-1], np.roll(seen[-1], 2, axis=1)]
    with pytest.raises(ImageError, match=r"moved by \d.\d px or more while 'pose'"):
        decode_captures(as_light(moved), SEQUENCE, name="pose")


COLUMN = {kind: [Pattern(kind, 0, i) for i in range(9)] for kind in ("bit", "inverse", "wave")}


@pytest.mark.parametrize(
    ("first", "second", "told"),
    [
        (COLUMN["bit"][6], COLUMN["inverse"][6], r"8 \(column-bit6\) and 9 .* do not fit the coarser stripes"),
        (COLUMN["bit"][8], COLUMN["bit"][7], r"4 \(column-bit8\) and 5 .* not a picture and its inverse"),
        (COLUMN["bit"][8], COLUMN["inverse"][8], "are not shifted as they should be"),
        (COLUMN["bit"][3], COLUMN["wave"][4], r"\(column-wave4\) is not shifted as it should be"),
        (COLUMN["wave"][2], COLUMN["wave"][3], r"\(column-wave2\) and 19 \(column-wave3\) are not shifted"),
        (Pattern("white"), COLUMN["bit"][8], r"2 \(white\) and 3 \(black\) do not show all of the screen"),
    ],
)
def test_exchanged_captures_are_named(seen, first, second, told):
    order = list(SEQUENCE.patterns)
    i, j = order.index(first), order.index(second)
    order[i], order[j] = order[j], order[i]
    images = [seen[SEQUENCE.patterns.index(pattern)] for pattern in order]
    with pytest.raises(ImageError, match=f"'pose' do not follow the order of the patterns: number.*{told}"):
        decode_captures(as_light(images), SEQUENCE, name="pose")


@pytest.mark.parametrize(
    ("doubled", "told"),
    [(8, r"9 \(column-bit6-inverse\) are not a picture"), (19, r"20 \(column-wave4\) is not shifted")],
)
def test_a_capture_taken_twice_is_named(seen, doubled, told):
    images = [*seen[:doubled], seen[doubled - 1], *seen[doubled + 1 :]]
    with pytest.raises(ImageError, match=told):
        decode_captures(as_light(images), SEQUENCE, name="pose")


def test_two_pictures_exchanged_with_their_inverses_are_told_by_the_borders_of_stripes(seen):
    images = [*seen[:7], *seen[9:11], *seen[7:9], *seen[11:]]
    with pytest.raises(ImageError, match=r"8 \(column-bit6\) .* do not fit the coarser stripes"):
        decode_captures(as_light(images), SEQUENCE, name="pose")


@pytest.mark.parametrize(
    ("steps", "pose", "spoil"),
    [
        (0, 1, lambda image: np.minimum(2 * image, 1)),  # overexposed: the finest stripes are white, and so are gaps
        (8, 0, lambda image: gaussian_filter(image, 10)),  # defocused: the edge of the screen shifts what is left
        (8, 0, lambda image: image + 0.25 * image[::-1]),  # mirrored by a desk: another part of the screen beside it
    ],
)
def test_bad_captures_in_order_are_not_refused_for_their_order(steps, pose, spoil):
    sequence = Sequence((320, 192), steps)
    images = [spoil(image) for image in as_light(captures(screen_poses(2)[pose], sequence))]
    assert len(decode_captures(images, sequence).corners.views[0]) > 100


def test_captures_in_reversed_order_are_told(seen):
    with pytest.raises(ImageError, match="do not follow the order of the patterns"):
        decode_captures(as_light(seen[::-1]), SEQUENCE, name="pose")


def test_a_dark_screen_is_told():
    dark = [np.full((240, 320), 20, np.uint8)] * len(SEQUENCE.patterns)
    with pytest.raises(ImageError, match="no lit screen is seen in 'pose'"):
        decode_captures(as_light(dark), SEQUENCE, name="pose")


def test_a_screen_of_which_next_to_nothing_is_seen_is_no_error_but_a_reason(seen):
    narrow = [image.copy() for image in seen]
    left = int(true_corners(LENS, SCREEN, POSE)[:, 0].min())
    for image in narrow:
        image[:, left + 8 :] = 12
    view = decode_captures(as_light(narrow), SEQUENCE).corners.views[0]
    assert not view.found
    assert "nodes could be decoded" in view.reason


def test_a_spacing_too_fine_for_the_camera_is_told_and_the_one_advised_does(seen):
    view = decode_captures(as_light(seen), SEQUENCE, spacing=4).corners.views[0]
    assert not view.found
    advised = re.fullmatch(
        r"\d+ nodes could be decoded; nodes 4 screen px apart have too few .*: give a spacing of (\d+) px or more",
        view.reason,
    )
    again = decode_captures(as_light(seen), SEQUENCE, spacing=int(advised[1])).corners.views[0]
    assert len(again) > 0.5 * (320 // int(advised[1])) * (192 // int(advised[1]))


@pytest.mark.parametrize("text", ["", "{}", '{"format_version": 1, "screen": 5}', '{"format_version": 2}'])
def test_a_manifest_that_is_none_is_refused(tmp_path, text):
    (tmp_path / "patterns.json").write_text(text)
    with pytest.raises(InputError, match="is not a list of patterns"):
        read_manifest(tmp_path)


@pytest.mark.parametrize("arguments", [((10, 600),), ((640, 480), 2), ((640, 480), 8, 20)])
def test_impossible_sequences_are_refused(arguments):
    with pytest.raises(InputError, match=r"must be|takes 3 or more"):
        Sequence(*arguments)


@pytest.mark.parametrize("spec", ["gray:1920", "gray:1920x1080:2", "gray:30x30", "gray:1920x1080:0"])
def test_impossible_screens_are_refused(spec):
    with pytest.raises(BoardError, match="screen"):
        parse_board(spec)


def test_a_screen_is_read_back_from_its_description():
    board = parse_board("gray:1920x1080")
    assert (board.columns, board.rows) == (120, 67)
    assert parse_board(board.spec) == board
    np.testing.assert_array_equal(board.screen_pixels(np.array([0, 121])), [[7.5, 7.5], [23.5, 23.5]])


def test_noise_free_captures_leave_hundredths_of_a_pixel():
    still = captures(POSE, sensor=Sensor(blur=0.7))
    view = decode_captures(as_light(still), SEQUENCE).corners.views[0]
    error = view.uv - true_corners(LENS, SCREEN, POSE)[view.ids]
    assert np.median(np.linalg.norm(error, axis=1)) < 0.03
