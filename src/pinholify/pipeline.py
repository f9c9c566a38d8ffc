"""From corners to a camera, whichever method."""

from __future__ import annotations

from pinholify.calibration.one_image import calibrate_one_image
from pinholify.calibration.result import Calibration
from pinholify.corners import CornerSet

METHODS = ("auto", "one-image")


def calibrate(
    corner_set: CornerSet,
    *,
    reference: str | None = None,
    method: str = "auto",
    kernel: str = "se",
    trend: str = "auto",
    mirrored: bool = False,
    square_mm: float | None = None,
) -> Calibration:
    """A perfect pinhole camera from the corners of several photographs of one board.

    ``reference`` names the image whose board makes the camera (the largest by default), ``method`` is one of
    ``METHODS``, ``kernel`` and ``trend`` are names of the registries in :mod:`pinholify.gp`. ``mirrored`` says that the
    image is a reflection, ``square_mm`` the side of a square. Raises InputError, CalibrationError or DegenerateError.
    """
    return calibrate_one_image(
        corner_set, reference=reference, kernel=kernel, trend=trend, mirrored=mirrored, square_mm=square_mm
    )
