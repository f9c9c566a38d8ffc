import os
import signal
from pathlib import Path

import numpy as np
import pytest

from pinholify.board import Checkerboard
from pinholify.detection import detect_files, files
from pinholify.detection.files import unique_names
from pinholify.errors import BoardError, ImageError, InputError
from pinholify.io.images import write_image

BOARD = Checkerboard(8, 6)


@pytest.fixture
def folder(tmp_path: Path, board_image) -> Path:
    image, _ = board_image(8, 6)
    write_image(tmp_path / "b.png", image)
    write_image(tmp_path / "a.jpg", image)
    write_image(tmp_path / "blank.png", np.full_like(image, 90))
    (tmp_path / "broken.jpg").write_bytes(b"no picture")
    return tmp_path


def test_views_keep_their_order_and_broken_files_a_reason(folder: Path):
    paths = [folder / name for name in ["b.png", "broken.jpg", "blank.png", "a.jpg"]]
    arrived = []
    corners = detect_files(paths, BOARD, workers=2, on_result=arrived.append)
    assert [view.name for view in corners.views] == ["b.png", "broken.jpg", "blank.png", "a.jpg"]
    assert [len(view) for view in corners.views] == [48, 0, 0, 48]
    assert "cannot be read" in corners.views[1].reason
    assert "no board" in corners.views[2].reason
    assert corners.image_size == (640, 480)
    assert arrived == list(corners.views)


def test_without_a_readable_file_there_is_nothing_to_return(folder: Path):
    with pytest.raises(ImageError, match=r"broken.jpg.*cannot be read"):
        detect_files([folder / "broken.jpg"], BOARD)
    with pytest.raises(ImageError, match="no images"):
        detect_files([], BOARD)


def test_a_path_is_no_list_and_a_text_no_board(folder: Path):
    for path in ("a.jpg", folder / "a.jpg"):
        with pytest.raises(InputError, match=r"one path was given where several are needed.* \['.*a.jpg'\]"):
            detect_files(path, BOARD)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"the board is given as a text; give pinholify.parse_board\('8x6'\)"):
        detect_files([folder / "a.jpg"], "8x6")  # type: ignore[arg-type]


def test_images_of_two_sizes_are_refused_by_name(folder: Path):
    write_image(folder / "small.png", np.zeros((100, 200), np.uint8))
    with pytest.raises(ImageError, match=r"2 of 3 are 640x480 like 'a.jpg', but 'small.png' is 200x100"):
        detect_files([folder / n for n in ["a.jpg", "small.png", "b.png"]], BOARD, workers=1)


def test_names_get_the_folders_they_need():
    paths = [Path("/x/one/a.png"), Path("/x/two/a.png"), Path("/x/two/b.png"), Path("/y/two/a.png")]
    assert unique_names(paths) == ["one/a.png", "x/two/a.png", "b.png", "y/two/a.png"]
    with pytest.raises(ImageError, match="twice"):
        unique_names([Path("/x/a.png"), Path("/x/a.png")])


def test_a_mistaken_size_is_said_even_where_some_images_seem_to_show_it(tmp_path: Path, board_image):
    """Two images of a larger board against one that fits: the size given is wrong for the photographs."""
    for name, columns in (("a", 9), ("b", 9), ("c", 7)):
        write_image(tmp_path / f"{name}.png", board_image(columns, 6)[0])
    with pytest.raises(BoardError, match="2 of 3 images show another board than 7x6"):
        detect_files([tmp_path / f"{name}.png" for name in "abc"], Checkerboard(7, 6))


detect_file = files._detect_file


def deadly(job, **options):
    """Ends its process on one picture, as a system that is out of memory does."""
    if job[1] == "blank.png":
        os.kill(os.getpid(), signal.SIGKILL)
    return detect_file(job, **options)


def test_a_picture_that_ends_its_process_is_reported_and_the_others_are_done(folder: Path, monkeypatch):
    monkeypatch.setattr(files, "_detect_file", deadly)
    names = ["b.png", "blank.png", "a.jpg", "broken.jpg"]
    corners = detect_files([folder / name for name in names], BOARD, workers=2)
    assert [view.name for view in corners.views] == names
    assert [len(view) for view in corners.views] == [48, 0, 48, 0]
    assert "died twice" in corners.views[1].reason
    assert "cannot be read" in corners.views[3].reason
