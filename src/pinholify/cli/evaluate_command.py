"""The command ``pinholify evaluate``."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import click

from pinholify.cli.options import examples, json_option, print_json
from pinholify.cli.sources import gather_corners, size_of_first
from pinholify.errors import CalibrationError, CameraFileError, ImageError


@click.command("evaluate", epilog=examples("pinholify evaluate camera.npz photos/ --json"))
@click.argument("camera", type=click.Path(path_type=Path))
@click.argument("images", nargs=-1, type=click.Path(path_type=Path))
@click.option("--corners", "table", metavar="FILE", help="Take corners from a table (.vnl) instead of photographs.")
@click.option("--folds", is_flag=True, help="Also print the held-out error over five folds of the boards.")
@click.option("--opencv/--no-opencv", default=True, show_default=True, help="Fit OpenCV's models to compare with.")
@click.option("--strict", is_flag=True, help="Exit with 1 if the verdict is poor.")
@json_option
def command(
    camera: Path, images: tuple[Path, ...], table: str | None, folds: bool, opencv: bool, strict: bool, as_json: bool
) -> None:
    """Score CAMERA on photographs of its board (IMAGES: files, folders, videos) or on a corner table.

    New photographs are scored with the camera unchanged; only the poses of their boards are fitted. On the photographs
    that the camera was made from, half of the boards are used to calibrate again and the others are scored. The board,
    its handedness and the image size are taken from the camera file.
    """
    from pinholify.cli.evaluation_output import print_evaluation, to_json
    from pinholify.evaluation.summary import evaluate
    from pinholify.evaluation.verdict import judge
    from pinholify.io.camera_file import read_camera
    from pinholify.pipeline import recalibrate

    calibration = read_camera(camera)
    size, mirrored = calibration.camera.image_size, calibration.camera.mirrored
    board = calibration.corner_set.board
    if calibration.findings.board_known is False:
        raise CameraFileError(f"'{camera}' was imported without a board; import it again with --board")
    if table is None:
        check_size(size_of_first(images), size, camera)  # looking for boards takes long
    corners = gather_corners(images, table, board, size if table is not None else None, mirrored)
    check_size(corners.image_size, size, camera)
    again = partial(recalibrate, calibration)
    evaluation = evaluate(calibration, corners, recalibrate=again, compare_opencv=opencv, kfold=folds)
    verdict = judge(evaluation, corners)
    if as_json:
        print_json(to_json(evaluation, verdict))
    else:
        print_evaluation(evaluation, verdict)
    if strict and verdict.level == "poor":
        raise CalibrationError(f"the camera is not good enough: {verdict.sentence}")


def check_size(found: tuple[int, int] | None, size: tuple[int, int], camera: Path) -> None:
    """Raise ImageError if images of the size ``found``, where it is known, are not of the ``size`` of ``camera``."""
    if found not in (None, size):
        raise ImageError(
            f"the images are {found[0]}x{found[1]} px, but '{camera}' was calibrated at {size[0]}x{size[1]}: use "
            "images of that size, or calibrate again at this one"
        )
