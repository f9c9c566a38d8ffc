"""Straightening many images of one camera: the map is built once."""

from __future__ import annotations

from dataclasses import dataclass, field

from pinholify.camera import VirtualCamera
from pinholify.errors import ImageError, InputError
from pinholify.rectification.maps import Image, RectificationMap, rectification_map, remap, splat
from pinholify.rectification.views import View, named_view

METHODS = ("remap", "splat")

LARGEST_SIDE = 32766
"""px; OpenCV resamples no larger image."""

MAX_PIXELS = 200_000_000
"""A larger result is refused: its map alone would take gigabytes."""


@dataclass(slots=True)
class Straightener:
    """Takes images of ``camera`` to the view called ``view_name`` (``camera`` or ``board``).

    ``size`` (width, height) px of the result defaults to the image's. ``method`` is ``remap`` (backward, cubic) or
    ``splat`` (the paper's). ``max_std`` px replaces the camera's domain as the limit of what is shown. Raises
    InputError for a name that is not known and for a size that is too large.
    """

    camera: VirtualCamera
    view_name: str = "camera"
    size: tuple[int, int] | None = None
    method: str = "remap"
    max_std: float | None = None
    view: View = field(init=False)
    _map: RectificationMap | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"'{self.method}' is no way to straighten; there are: {', '.join(METHODS)}")
        width, height = self.size or self.camera.image_size
        if max(width, height) > LARGEST_SIDE or width * height > MAX_PIXELS:
            raise InputError(
                f"a result of {width}x{height} was asked for where sides of at most {LARGEST_SIDE} px and "
                f"{MAX_PIXELS // 1_000_000} megapixels can be made; choose a smaller size"
            )
        self.view = named_view(self.camera, self.view_name, self.size, self.max_std)

    def __call__(self, image: Image) -> Image:
        """The straightened image, of the same depth and channels; raises ImageError on an image of another size."""
        height, width = image.shape[:2]
        if (width, height) != self.camera.image_size:
            raise ImageError(
                f"the image is {width}x{height} and the camera was calibrated at "
                f"{self.camera.image_size[0]}x{self.camera.image_size[1]}: give an image of that size"
            )
        if self.method == "splat":
            return splat(image, self.camera, self.view, max_std=self.max_std)
        if self._map is None:
            self._map = rectification_map(self.camera, self.view, max_std=self.max_std)
        return remap(image, self._map)
