from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as PillowImage

from pinholify.errors import ImageError, OutputError
from pinholify.io.images import image_paths, read_image, write_image

RNG = np.random.default_rng(3)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(40, 30), (40, 30, 3)])
def test_lossless_images_come_back_as_written(tmp_path: Path, suffix, dtype, shape):
    image = RNG.integers(0, np.iinfo(dtype).max, shape, dtype=dtype)
    write_image(tmp_path / f"a{suffix}", image)
    back = read_image(tmp_path / f"a{suffix}")
    assert back.dtype == dtype
    assert np.array_equal(back, image)
    assert [p.name for p in tmp_path.iterdir()] == [f"a{suffix}"]


def test_rotation_of_the_camera_is_ignored(tmp_path: Path):
    picture = PillowImage.fromarray(np.zeros((20, 50), np.uint8))
    exif = PillowImage.Exif()
    exif[0x0112] = 6
    picture.save(tmp_path / "turned.jpg", exif=exif)
    assert read_image(tmp_path / "turned.jpg").shape[:2] == (20, 50)


def photograph(path: Path) -> bytes:
    image = cv2.GaussianBlur(RNG.integers(0, 255, (200, 300, 3), dtype=np.uint8), (0, 0), 1.0)
    write_image(path, image)
    return path.read_bytes()


@pytest.mark.parametrize("suffix", [".jpg", ".png", ".bmp", ".tif", ".webp"])
def test_a_file_cut_short_is_refused(tmp_path: Path, suffix):
    path = tmp_path / f"cut{suffix}"
    data = photograph(path)
    assert read_image(path).shape == (200, 300, 3)
    path.write_bytes(data[: len(data) * 6 // 10])
    with pytest.raises(ImageError, match="cut"):
        read_image(path)


@pytest.mark.parametrize(
    ("content", "words"), [(b"", "is empty"), (b"Dear reader, this is text.\n", "cannot be read as an image")]
)
def test_what_is_no_image_is_refused(tmp_path: Path, content, words):
    path = tmp_path / "a.jpg"
    path.write_bytes(content)
    with pytest.raises(ImageError, match=words):
        read_image(path)


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path):
    with pytest.raises(ImageError, match="no file"):
        read_image(tmp_path / "none.png")
    with pytest.raises(ImageError, match="folder"):
        read_image(tmp_path)


@pytest.mark.parametrize("size", [(20000, 10000), (12000, 8000)])
def test_too_many_pixels_are_refused_from_the_header(tmp_path: Path, size):
    header = PillowImage.new("1", size)
    header.save(tmp_path / "huge.png")
    with pytest.raises(ImageError, match="megapixels are read"):
        read_image(tmp_path / "huge.png", max_pixels=90_000_000)


def test_folders_give_their_images_in_natural_order(tmp_path: Path):
    for name in ["b10.PNG", "b2.jpg", "notes.txt", "a.tiff"]:
        (tmp_path / name).write_bytes(b"x")
    alone = tmp_path / "notes.txt"
    assert [p.name for p in image_paths([tmp_path, alone])] == ["a.tiff", "b2.jpg", "b10.PNG", "notes.txt"]


def test_nothing_to_read_is_refused(tmp_path: Path):
    with pytest.raises(ImageError, match="holds no images"):
        image_paths([tmp_path])
    with pytest.raises(ImageError, match="no images were given"):
        image_paths([])


def test_what_cannot_be_written_is_refused_and_nothing_is_lost(tmp_path: Path):
    image = np.zeros((5, 5), np.uint16)
    with pytest.raises(OutputError, match="16 bits"):
        write_image(tmp_path / "a.jpg", image)
    with pytest.raises(OutputError, match="does not support"):
        write_image(tmp_path / "a.xyz", image)
    with pytest.raises(OutputError, match="cannot be written"):
        write_image(tmp_path / "nowhere" / "a.png", image)
    assert not list(tmp_path.iterdir())
