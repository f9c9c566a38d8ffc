"""Straightening many images of one camera with a map that is built once."""

from __future__ import annotations

from dataclasses import dataclass, field

from pinholify.camera import VirtualCamera, virtual
from pinholify.errors import ImageError, InputError
from pinholify.rectification.maps import Image, Sampler, rectification_map, sampler
from pinholify.rectification.splatting import Splatter, splatter
from pinholify.rectification.views import STRAIGHT_ON, View, YawPitchRoll, named_view

METHODS = ("remap", "splat")

LARGEST_SIDE = 32766
"""px; OpenCV does not resample larger images."""

MAX_PIXELS = 200_000_000
"""Larger results are refused: their maps alone would take gigabytes."""


@dataclass(slots=True)
class Straightener:
    """Converts images of ``camera`` to the view called ``view_name``.

    ``size`` (width, height) px of the result defaults to the image's. ``method`` is ``remap`` (backward, cubic) or
    ``splat`` (the paper's, several times slower). ``max_std`` (px) replaces the camera's own limit of the standard
    deviation of what is shown. ``turn``, ``fov`` and ``keep`` are those of
    :func:`pinholify.rectification.views.named_view`. ``fixed_point`` maps, for video, take less memory and have a
    resolution of 1/32 px. Raises InputError for an unknown name and a size that is too large, CalibrationError for a
    view that shows nothing.
    """

    camera: VirtualCamera
    view_name: str = "camera"
    size: tuple[int, int] | None = None
    method: str = "remap"
    max_std: float | None = None
    turn: YawPitchRoll = STRAIGHT_ON
    fov: float | None = None
    keep: str = "all"
    fixed_point: bool = False
    view: View = field(init=False)
    _sampler: Sampler | Splatter | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"unknown method '{self.method}': choose one of {', '.join(METHODS)}")
        if self.size is not None:
            _check_size(self.size)
        self.view = named_view(
            virtual(self.camera), self.view_name, self.size, self.max_std, turn=self.turn, fov=self.fov, keep=self.keep
        )
        _check_size(self.view.size)

    def __call__(self, image: Image) -> Image:
        """The straightened image, of the same dtype and channels; raises ImageError for an image of another size."""
        height, width = image.shape[:2]
        if (width, height) != self.camera.image_size:
            raise ImageError(
                f"the image is {width}x{height} and the camera was calibrated at "
                f"{self.camera.image_size[0]}x{self.camera.image_size[1]}: give an image of that size, "
                "or make the camera of this mode with 'pinholify mode'"
            )
        if self._sampler is None:
            self._sampler = self._made_sampler()
        return self._sampler(image)

    def _made_sampler(self) -> Sampler | Splatter:
        if self.method == "splat":
            return splatter(self.camera, self.view, max_std=self.max_std)
        rectification = rectification_map(self.camera, self.view, max_std=self.max_std)
        return sampler(rectification, self.camera.image_size, fixed_point=self.fixed_point)


def _check_size(size: tuple[int, int]) -> None:
    width, height = size
    if max(size) > LARGEST_SIDE or width * height > MAX_PIXELS:
        raise InputError(
            f"a result of {width}x{height} was requested, but at most {LARGEST_SIDE} px per side and "
            f"{MAX_PIXELS // 1_000_000} megapixels are possible; choose a smaller size"
        )
