"""The errors of the package. Each message says what was found, what was needed and what to do.

::

    PinholifyError
    ├── InputError             something the user gave cannot be used
    │   ├── BoardError         a board description that cannot be read
    │   ├── ImageError         an image that cannot be read, is too large, or is of the wrong size
    │   ├── CornerTableError   a corner table that breaks the format
    │   └── CameraFileError    a camera file that is foreign, truncated or newer
    ├── CalibrationError       the corners do not determine a camera
    │   └── DegenerateError    the boards' poses do not determine K
    └── OutputError            a result cannot be written

A board that is not found in an image is not an error but a result with a reason (:class:`pinholify.corners.Corners`).
"""


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


class OutputError(PinholifyError):
    """A result cannot be written."""
