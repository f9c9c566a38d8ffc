"""The errors a caller may meet. Each message says what was found, what was needed and what to do.

::

    PinholifyError
    ├── InputError             something the user gave cannot be used
    │   ├── BoardError         a board description that cannot be read
    │   ├── ImageError         an image that cannot be read, or is too large
    │   ├── CornerTableError   a corner table that breaks the format
    │   └── CameraFileError    a camera file that is foreign, cut short or newer
    ├── CalibrationError       the corners do not determine a camera
    │   └── DegenerateError    the boards stand so that K cannot be told
    └── OutputError            a result cannot be written

A board that is not found in an image is no error but a result with a reason (:class:`pinholify.corners.Corners`).
"""


class PinholifyError(Exception):
    """Base of all errors of this package; its text is one sentence fit for a person."""


class InputError(PinholifyError):
    """Something the user gave cannot be used."""


class BoardError(InputError):
    """A board description that cannot be read or cannot exist."""


class ImageError(InputError):
    """An image that cannot be read, is too large, or has another size than the camera's."""


class CornerTableError(InputError):
    """A corner table that breaks the format."""


class CameraFileError(InputError):
    """A camera file that is foreign, cut short, or of a newer version."""


class CalibrationError(PinholifyError):
    """The corners do not determine a camera."""


class DegenerateError(CalibrationError):
    """The boards stand so that the intrinsics cannot be told, e.g. all parallel."""


class OutputError(PinholifyError):
    """A result cannot be written."""
