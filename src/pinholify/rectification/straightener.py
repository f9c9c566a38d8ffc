"""Straightening many images of one camera with a map that is built once."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

from pinholify.camera import VirtualCamera, virtual
from pinholify.errors import ImageError, InputError
from pinholify.rectification.maps import Image, Sampler, rectification_map, sampler
from pinholify.rectification.options import DEFAULT_VIEW, METHODS, ViewOptions
from pinholify.rectification.splatting import Splatter, splatter
from pinholify.rectification.views import View, named_view

MAX_SIDE_PX = 32766
"""px; OpenCV does not resample larger images."""

MAX_PIXELS = 200_000_000
"""Larger results are refused: their maps alone would take gigabytes."""


@dataclass(frozen=True, eq=False)
class Straightener:
    """Converts images of ``camera`` to the view that ``options`` describe.

    ``method`` is ``remap`` (backward, cubic) or ``splat`` (the paper's, several times slower). ``fixed_point`` maps,
    for video, take less memory and have a resolution of 1/32 px. The map is built for the first image and kept.
    Copies, also those sent to other processes, build their own. Raises InputError for an unknown method and a size
    that is too large, CalibrationError for a view that shows nothing.
    """

    camera: VirtualCamera
    options: ViewOptions = DEFAULT_VIEW
    method: str = "remap"
    fixed_point: bool = False
    view: View = field(init=False)

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise InputError(f"unknown method '{self.method}': choose one of {', '.join(METHODS)}")
        if self.options.size is not None:
            _check_size(self.options.size)
        object.__setattr__(self, "view", named_view(virtual(self.camera), self.options))
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
        return self._sampler(image)

    @cached_property
    def _sampler(self) -> Sampler | Splatter:
        if self.method == "splat":
            return splatter(self.camera, self.view, max_std=self.options.max_std)
        rectification = rectification_map(self.camera, self.view, max_std=self.options.max_std)
        return sampler(rectification, self.camera.image_size, fixed_point=self.fixed_point)

    def __getstate__(self) -> dict[str, Any]:
        return {each.name: getattr(self, each.name) for each in fields(self)}


def _check_size(size: tuple[int, int]) -> None:
    width, height = size
    if max(size) > MAX_SIDE_PX or width * height > MAX_PIXELS:
        raise InputError(
            f"a result of {width}x{height} was requested, but at most {MAX_SIDE_PX} px per side and "
            f"{MAX_PIXELS // 1_000_000} megapixels are possible; choose a smaller size"
        )
