"""The errors of the package. Each message says what was found, what was needed and what to do.

::

    PinholifyError
    ├── InputError             something the user gave cannot be used
    │   ├── BoardError         a board description that cannot be read
    │   ├── ImageError         an image that cannot be read, is too large, or is of the wrong size
    │   ├── CornerTableError   a corner table that breaks the format
    │   └── CameraFileError    a camera file that is foreign, truncated or newer
    ├── CalibrationError       the corners do not determine a camera
    │   ├── DegenerateError    the boards' poses do not determine K
    │   └── UnsolvableError    the equations have no solution
    └── OutputError            a result cannot be written

A board that is not found in an image is not an error but a result with a reason (:class:`pinholify.corners.Corners`).
"""

from collections.abc import Iterator
from contextlib import contextmanager


class PinholifyError(Exception):
    """Base of all errors of this package; its text is one sentence for the user."""


class InputError(PinholifyError):
    """Something the user gave cannot be used."""


class BoardError(InputError):
    """A board description that cannot be read or cannot exist."""


class ImageError(InputError):
    """An image that cannot be read, is too large, or is not of the camera's size."""


class CornerTableError(InputError):
    """A corner table that breaks the format."""


class CameraFileError(InputError):
    """A camera file that is foreign, truncated, or of a newer version."""


class CalibrationError(PinholifyError):
    """The corners do not determine a camera."""


class DegenerateError(CalibrationError):
    """The boards' poses do not determine the intrinsics, e.g. because all are parallel."""


class UnsolvableError(CalibrationError):
    """The corners lead to equations without a solution."""


class OutputError(PinholifyError):
    """A result cannot be written."""


@contextmanager
def solving() -> Iterator[None]:
    """Raise UnsolvableError for a numpy.linalg.LinAlgError inside the block, or inside the function it decorates."""
    from numpy.linalg import LinAlgError  # slow to load, and few who need this module need it

    try:
        yield
    except LinAlgError as error:
        raise UnsolvableError(
            f"the corners lead to equations without a solution ({error}): check for wrong corners, a wrong board size "
            "or boards that all have the same orientation"
        ) from None
