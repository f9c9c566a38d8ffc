"""Image files: listed, read at full size and bit depth, and written completely or not at all."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pinholify.errors import ImageError, OutputError
from pinholify.io.files import atomic_path

Image = NDArray[Any]
"""(height, width), (height, width, 3) BGR or (height, width, 4) BGRA, uint8 or uint16."""

IMAGE_SUFFIXES = frozenset(
    [".bmp", ".jpeg", ".jpg", ".jp2", ".png", ".webp", ".avif", ".pbm", ".pgm", ".ppm", ".tif", ".tiff"]
)
"""Endings of images in a folder; a file given by name is tried whatever its ending."""

MAX_PIXELS = 160_000_000
"""Larger images are refused before decoding. The largest camera sensors on sale have 151 megapixels."""


def image_paths(arguments: Iterable[str | Path]) -> list[Path]:
    """The image files of ``arguments``, with folders replaced by the images in them in natural order of their names.

    Raises ImageError for no arguments and for a folder without images; whether files exist is not checked.
    """
    paths: list[Path] = []
    for argument in map(Path, arguments):
        if not argument.is_dir():
            paths.append(argument)
            continue
        inside = [path for path in argument.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
        if not inside:
            raise ImageError(f"the folder '{argument}' holds no images; give one that does, or image files")
        paths += sorted(inside, key=lambda path: natural_order(path.name))
    if not paths:
        raise ImageError("no images were given; give image files or a folder of images")
    return paths


def natural_order(name: str) -> list[tuple[int, str]]:
    """A sorting key that puts image2 before image10."""
    parts = re.split(r"(\d+)", name.lower())
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def read_image(path: str | Path, *, max_pixels: int = MAX_PIXELS) -> Image:
    """The image in the file ``path``: grey or colour (BGR), uint8 or uint16, at full size, without alpha.

    EXIF rotation is ignored on purpose: a calibration belongs to the sensor, whose pixels do not move when
    the camera is turned. Raises ImageError for a file that is missing, empty, cut short, not an image, or of more
    than ``max_pixels``.
    """
    return decode_image(read_bytes(path), str(path), max_pixels=max_pixels)


def decode_image(data: bytes, name: str, *, max_pixels: int = MAX_PIXELS, keep_alpha: bool = False) -> Image:
    """Decode the bytes ``data`` of an image file called ``name``, as :func:`read_image` does.

    With ``keep_alpha`` an image that has transparency is (height, width, 4) BGRA. Raises ImageError for data that is
    empty, cut short, not an image, or of more than ``max_pixels``.
    """
    import cv2

    if not data:
        raise ImageError(f"'{name}' is empty; copy the image again")
    _check_header(data, name, max_pixels)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR | cv2.IMREAD_IGNORE_ORIENTATION
    if keep_alpha and _has_alpha(data):
        flags = cv2.IMREAD_UNCHANGED
    try:
        image = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        image = None
    if image is None:
        raise ImageError(f"'{name}' cannot be read as an image; give a photograph, e.g. in JPEG, PNG or TIFF")
    if image.shape[0] * image.shape[1] > max_pixels:
        raise _too_large(name, image.shape[0] * image.shape[1], max_pixels)
    return np.asarray(image)


def read_bytes(path: str | Path) -> bytes:
    """The content of the image file ``path``; raises ImageError if it cannot be read."""
    try:
        return Path(path).read_bytes()
    except IsADirectoryError:
        raise ImageError(f"'{path}' is a folder where an image is needed; name the files in it") from None
    except FileNotFoundError:
        raise ImageError(f"there is no file '{path}'; check the name") from None
    except OSError as error:
        raise ImageError(f"'{path}' cannot be read: {error.strerror or error}") from None


def _check_header(data: bytes, name: str, max_pixels: int) -> None:
    """Raise ImageError for too many pixels and for a file cut short, whose missing end OpenCV would fill with grey.

    A format that Pillow does not know passes; OpenCV then decides.
    """
    from PIL import Image as PillowImage
    from PIL import UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            picture = PillowImage.open(BytesIO(data))
    except PillowImage.DecompressionBombError:
        raise _too_large(name, None, max_pixels) from None
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError):
        return
    with picture:
        if picture.width * picture.height > max_pixels:
            raise _too_large(name, picture.width * picture.height, max_pixels)
        _check_complete(name, picture)


def _has_alpha(data: bytes) -> bool:
    """Whether an image that passed :func:`_check_header` has transparency, according to its header."""
    from PIL import Image as PillowImage

    try:
        with PillowImage.open(BytesIO(data)) as picture:
            return "A" in picture.getbands() or "transparency" in picture.info
    except (OSError, SyntaxError, ValueError):
        return False


def _check_complete(name: str, picture: Any) -> None:
    try:
        if picture.format == "JPEG":
            # Decoding at an eighth of the size is fast and still reads all bytes of the file.
            picture.draft("L", (max(picture.width // 8, 1), max(picture.height // 8, 1)))
            picture.load()
        elif picture.format == "PNG":
            picture.verify()
    except (OSError, SyntaxError, ValueError):
        raise ImageError(f"'{name}' is cut short or damaged; copy the image again") from None


def _too_large(name: str, pixels: int | None, max_pixels: int) -> ImageError:
    most = f"{max_pixels / 1e6:.0f} megapixels"
    if pixels is None:
        return ImageError(f"'{name}' is too large: at most {most} are read; give a smaller image")
    return ImageError(f"'{name}' has {pixels / 1e6:.0f} megapixels where at most {most} are read; give a smaller image")


def write_image(path: str | Path, image: Image) -> None:
    """Write ``image`` (grey or BGR, uint8 or uint16) to ``path``, atomically, in the format of its suffix.

    Raises OutputError if the format does not support the image, or if the file cannot be written.
    """
    data = encode_image(image, str(path))
    with atomic_path(path) as temporary:
        temporary.write_bytes(data)


def encode_image(image: Image, name: str) -> bytes:
    """Encode ``image`` (grey, BGR or BGRA, uint8 or uint16) in the format of the suffix of ``name``.

    Raises OutputError if the format does not support the image.
    """
    import cv2

    suffix = Path(name).suffix.lower()
    if image.dtype == np.uint16 and suffix in {".jpg", ".jpeg", ".jpe", ".webp", ".bmp"}:
        raise OutputError(f"'{name}' cannot hold 16 bits per channel; write PNG or TIFF instead")
    options = [cv2.IMWRITE_JPEG_QUALITY, 97] if suffix in {".jpg", ".jpeg", ".jpe"} else []
    try:
        encoded, data = cv2.imencode(suffix, image, options)
    except cv2.error:
        encoded = False
    if not encoded:
        raise OutputError(f"'{name}' cannot be written: the format '{suffix}' does not support this image; try .png")
    return bytes(data)
