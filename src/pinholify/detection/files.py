"""Image files to the corners of one camera: in parallel, in order, whatever fails in single files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from pinholify.board import Board, Checkerboard
from pinholify.camera import VirtualCamera
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.detection.checkerboard import detect_size
from pinholify.detection.detect import detect_board
from pinholify.detection.second_look import look_again
from pinholify.errors import BoardError, ImageError, InputError
from pinholify.io.images import read_image
from pinholify.io.processes import DIED, in_processes

_Job = TypeVar("_Job")
_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True, eq=False)
class _Seen:
    """The result for one file: ``corners``, and its ``size`` (width, height) in px, None if it cannot be read."""

    corners: Corners
    size: tuple[int, int] | None


def detect_files(
    paths: Sequence[str | Path],
    board: Board,
    *,
    mirrored: bool = False,
    workers: int | None = 1,
    on_result: Callable[[Corners], object] | None = None,
) -> CornerSet:
    """The corners of ``board`` in the image files ``paths``, in their order.

    ``workers`` processes share the work; None means one per CPU. More than one are spawned, so a script that uses them
    needs the usual ``if __name__ == "__main__":``. ``on_result`` is called with the corners of each image, in order.

    A file that cannot be read, or that crashes its process, becomes a view without corners and with a reason. Raises
    ImageError if no file can be read, if files differ in size, or if a file is given twice; BoardError if the images
    show a larger board; InputError for a single path and for a board given as text.
    """
    _check_arguments(paths, board)
    if not paths:
        raise ImageError("no images were given; give image files or a folder of images")
    files = [Path(path) for path in paths]
    jobs = list(zip(files, unique_names(files), strict=True))
    seen = []
    detect = partial(_detect_file, board=board, mirrored=mirrored)
    for result in _map(detect, jobs, workers, _lost):
        seen.append(result)
        if on_result is not None:
            on_result(result.corners)
    views = tuple(result.corners for result in seen)
    _check_size_of_board(views, board)
    return CornerSet(board, _common_size(seen), views)


def _check_arguments(paths: object, board: object) -> None:
    """Raise InputError for a single path, which would be iterated by letters, and for a board given as text."""
    if isinstance(paths, str | os.PathLike):
        raise InputError(f"one path was given where several are needed; give a list: ['{os.fspath(paths)}']")
    if isinstance(board, str):
        raise InputError(f"the board is given as a text; give pinholify.parse_board('{board}')")


def look_again_in_files(
    paths: Sequence[str | Path],
    corners: CornerSet,
    camera: VirtualCamera,
    *,
    workers: int | None = 1,
    on_result: Callable[[Corners], object] | None = None,
) -> CornerSet:
    """``corners``, found in the image files ``paths``, after a second look with their ``camera``.

    See :func:`pinholify.detection.look_again`; ``workers`` and ``on_result`` are as in :func:`detect_files`. Raises
    ImageError where the images are not of the camera's size.
    """
    if corners.image_size != camera.image_size:
        raise ImageError(
            f"the images are {_pixels(corners.image_size)} px, but the camera was calibrated at "
            f"{_pixels(camera.image_size)}: give photographs of that camera, or no camera"
        )
    views = []
    again = partial(_look_again_in_file, board=corners.board, camera=camera)
    jobs = list(zip(map(Path, paths), corners.views, strict=True))
    for view in _map(again, jobs, workers, lambda job: job[1]):
        views.append(view)
        if on_result is not None:
            on_result(view)
    return corners.with_views(views)


def _look_again_in_file(job: tuple[Path, Corners], *, board: Board, camera: VirtualCamera) -> Corners:
    path, view = job
    return look_again(read_image(path), view, board, camera) if view.found else view


def _pixels(image_size: tuple[int, int]) -> str:
    return f"{image_size[0]}x{image_size[1]}"


def detect_size_in_files(
    paths: Sequence[str | Path],
    *,
    workers: int | None = 1,
    on_result: Callable[[Checkerboard | None], object] | None = None,
) -> tuple[Checkerboard, int]:
    """The checkerboard that most of the image files ``paths`` show completely, columns ≥ rows, and how many do.

    Images that do not show a complete board are ignored. ``workers`` is as in :func:`detect_files`; ``on_result`` is
    called with the board of each image, or None. Raises BoardError if no image shows a complete board, and if two sizes
    are equally frequent.
    """
    sizes = Counter[Checkerboard]()
    for board in _map(_size_in_file, [Path(path) for path in paths], workers, lambda path: None):
        if board is not None:
            sizes[board] += 1
        if on_result is not None:
            on_result(board)
    if not sizes:
        images = "1 image" if len(paths) == 1 else f"{len(paths)} images"
        raise BoardError(
            f"the size of the board cannot be determined: no complete checkerboard is visible in {images}; give its "
            "inner corners, columns x rows, for example 9x6, or name the board if it is of another kind, for example "
            "charuco:9x7:DICT_4X4_100:0.75"
        )
    (board, count), *others = sizes.most_common()
    if others and others[0][1] == count:
        raise BoardError(
            f"the size of the board cannot be determined: {count} of {len(paths)} images show {board.spec} inner "
            f"corners and as many show {others[0][0].spec}; give the size to look for"
        )
    return board, count


def _size_in_file(path: Path) -> Checkerboard | None:
    try:
        return detect_size(read_image(path))
    except ImageError:
        return None


def _check_size_of_board(views: Sequence[Corners], board: Board) -> None:
    """Raise BoardError if at least as many images show a larger board as seem to show ``board``."""
    larger = [view for view in views if view.larger_board]
    if 0 < sum(view.found for view in views) <= len(larger):
        raise BoardError(
            f"{len(larger)} of {len(views)} images show another board than {board.spec} (in '{larger[0].name}' "
            f"{larger[0].reason}): give the size of the board in the photographs, its inner corners, columns x rows"
        )


def unique_names(paths: Sequence[Path]) -> list[str]:
    """File names, each with as many parent folders as make it unique.

    Raises ImageError if a file or folder is given twice.
    """
    twice = [path for path, count in Counter(path.absolute() for path in paths).items() if count > 1]
    if twice:
        kind = "folder" if twice[0].is_dir() else "image"
        raise ImageError(f"the {kind} '{twice[0]}' is given twice; name each {kind} once")
    names = [path.name for path in paths]
    depth = 1
    while len(set(names)) < len(names):
        depth += 1
        shared = {name for name, count in Counter(names).items() if count > 1}
        names = [
            "/".join(path.absolute().parts[-depth:]) if name in shared else name
            for path, name in zip(paths, names, strict=True)
        ]
    return names


def _detect_file(job: tuple[Path, str], *, board: Board, mirrored: bool) -> _Seen:
    path, name = job
    try:
        image = read_image(path)
    except ImageError as error:
        return _Seen(not_found(name, str(error)), None)
    height, width = image.shape[:2]
    return _Seen(detect_board(image, board, name=name, mirrored=mirrored), (width, height))


def _lost(job: tuple[Path, str]) -> _Seen:
    return _Seen(not_found(job[1], DIED), None)


def _map(
    function: Callable[[_Job], _Result],
    jobs: Sequence[_Job],
    workers: int | None,
    died: Callable[[_Job], _Result],
) -> Iterator[_Result]:
    """``function`` of every job, in order; ``died`` of those that crash their process."""
    workers = min(workers or os.cpu_count() or 1, len(jobs))
    if workers <= 1:
        yield from map(function, jobs)
        return
    results: dict[int, _Result] = {}
    following = 0
    numbered = list(enumerate(jobs))
    ended = in_processes(partial(_numbered, function), numbered, workers, died=partial(_numbered, died))
    for number, result in ended:
        results[number] = result
        while following in results:
            yield results.pop(following)
            following += 1


def _numbered(function: Callable[[_Job], _Result], job: tuple[int, _Job]) -> tuple[int, _Result]:
    return job[0], function(job[1])


def _common_size(seen: list[_Seen]) -> tuple[int, int]:
    """The size (width, height) of all images that could be read; raises ImageError if there are none, or several."""
    sizes = Counter(result.size for result in seen if result.size is not None)
    if not sizes:
        raise ImageError(
            seen[0].corners.reason
            if len(seen) == 1
            else f"none of {len(seen)} images can be read; the first: {seen[0].corners.reason}"
        )
    (usual, count), *others = sizes.most_common()
    if others:
        first = {result.size: result.corners.name for result in reversed(seen)}
        other = others[0][0]
        raise ImageError(
            f"the images differ in size: {count} of {sum(sizes.values())} are {usual[0]}x{usual[1]} like "
            f"'{first[usual]}', but '{first[other]}' is {other[0]}x{other[1]}; "
            "give images of one camera at one size"
        )
    return usual
