"""Rendered data sets with their truth, including the six cameras of the paper's Table 1.

:data:`DATASETS` defines each data set completely, with a reason for each choice in ``reasons``. The table was fixed
before the first calibration was run on its images, and is not changed to improve a result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pinholify.arrays import Floats, frozen
from pinholify.board import Checkerboard
from pinholify.geometry import Pose
from pinholify.simulation.lenses import BrownConrady, Lens, Mirror, Pinhole, Resized, Unity
from pinholify.simulation.lenses.base import image_centre
from pinholify.simulation.photograph import Sensor, photograph
from pinholify.simulation.rendering import pixel_rays, render
from pinholify.simulation.scene import CheckerboardTexture, Scene, TexturedPlane, cloudy
from pinholify.simulation.views import board_poses, true_corners, virtual_camera


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """One rendered view: ``image`` (h, w) uint8, true ``corners`` (N, 2) px in id order, true ``pose``."""

    name: str
    image: NDArray[np.uint8]
    corners: Floats
    pose: Pose

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        object.__setattr__(self, "image", frozen(self.image, (None, None), np.uint8))
        object.__setattr__(self, "corners", frozen(self.corners, (None, 2)))


@dataclass(frozen=True, slots=True, eq=False)
class CameraTruth:
    """What a calibration should find: the rays of a grid of ``pixels``, and the virtual camera.

    ``pixels`` (N, 2); ``origins`` (N, 3) in squares and unit ``directions`` (N, 3) in the true camera frame, NaN where
    a pixel sees nothing. ``size`` is (width, height) px; ``central`` is whether there is a single centre, ``mirrored``
    whether images are reversed. ``virtual_camera`` is (f, uc, vc) in squares for the first view's board, None for a
    system without a single centre.
    """

    size: tuple[int, int]
    pixels: Floats
    origins: Floats
    directions: Floats
    central: bool
    mirrored: bool
    virtual_camera: tuple[float, float, float] | None

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for name, width in (("pixels", 2), ("origins", 3), ("directions", 3)):
            object.__setattr__(self, name, frozen(getattr(self, name), (len(self.pixels), width)))


@dataclass(frozen=True, slots=True)
class Dataset:
    """``views`` photographs of ``board`` through ``lens`` by ``sensor``; all randomness comes from ``seed``.

    The poses suit ``lens`` and all of ``companions``: data sets with the same list of lenses and the same seed have the
    same poses. ``squares`` are the grey values of the dark and the light squares, 0 … 1. ``reasons`` explain each
    choice.
    """

    name: str
    title: str
    lens: Lens
    board: Checkerboard
    views: int
    sensor: Sensor
    seed: int
    reasons: Mapping[str, str]
    squares: tuple[float, float] = (0.07, 0.9)
    companions: tuple[Lens, ...] = ()

    def poses(self) -> tuple[Pose, ...]:
        """The poses of all views; the first board fills the frame."""
        return board_poses(self.companions or (self.lens,), self.board, self.views, seed=self.seed)

    def photographs(self, limit: int | None = None) -> Iterator[Photograph]:
        """The views one at a time, all or only the first ``limit``; the limit does not change them."""
        rays = pixel_rays(self.lens)
        dark, light = self.squares
        texture, background = CheckerboardTexture(self.board, dark=dark, light=light), cloudy(0.45, seed=self.seed)
        for i, pose in enumerate(self.poses()[:limit]):
            picture = render(rays, Scene((TexturedPlane(pose, texture),), background))
            image = photograph(picture, self.sensor, (self.seed, i))
            yield Photograph(f"{self.name}-{i:02d}", image, true_corners(self.lens, self.board, pose), pose)

    def truth(self, columns: int = 49, rows: int = 28) -> CameraTruth:
        """The truth on a grid of ``columns`` × ``rows`` pixels that extends to the image's borders."""
        width, height = self.lens.size
        grid = np.meshgrid(np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows))
        pixels = np.stack(grid, axis=-1).reshape(-1, 2)
        rays = self.lens.unproject(pixels)
        virtual = virtual_camera(self.poses()[0]) if self.lens.central else None
        return CameraTruth(
            self.lens.size, pixels, *rays, self.lens.central, mirrored(self.lens), virtual_camera=virtual
        )


def reduced(dataset: Dataset, factor: float) -> Dataset:
    """``dataset`` with images ``factor`` times smaller, for a quick look; blur and noise in px are unchanged."""

    def smaller(lens: Lens) -> Lens:
        width, height = (round(length / factor) for length in lens.size)
        return Resized(lens, (width, height))

    return replace(dataset, lens=smaller(dataset.lens), companions=tuple(map(smaller, dataset.companions)))


def mirrored(lens: Lens) -> bool:
    """Whether ``lens`` shows the scene reversed, evaluated at the centre of its image."""
    middle = image_centre(lens.size) + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    ahead, right, down = lens.unproject(middle).directions
    return bool(np.linalg.det([right - ahead, down - ahead, ahead]) < 0)


_WIDE, _TALL = Checkerboard(15, 9), Checkerboard(14, 9)

_4K = (3840, 2160)
_UNITY = (Pinhole(_4K, 2000.0), Unity(_4K, 2000.0, 55.0), Unity(_4K, 2000.0, -40.0, (-0.15, 0.15)))
_GAME_ENGINE = Sensor(blur=0.6)
_UNITY_REASONS = {
    "lens": "a field of 88 degrees; the paper gives no numbers: barrel +55 centred, pincushion -40 around a "
    "point left and low, about as strong as its figures show",
    "poses": "the paper's three Unity sets share one scene, so the boards have the same poses in all three",
    "squares": "the engine's black and white materials",
    "blur": "0.6 px: multisampling and the bilinear lookup of the post-processing effect",
    "noise": "none beyond eight bits: a game engine has no photon noise",
    "jpeg": "none: screenshots are stored losslessly",
}

_WEBCAM = BrownConrady(
    (2560, 1440), (1700.0, 1702.0), (14.0, -9.0), radial=(-0.08, 0.03, 0.0), tangential=(4e-4, -3e-4)
)
_PRINTED = (0.13, 0.72)
_PRINTED_REASON = "toner reflects an eighth of the light, and automatic exposure leaves room above the paper"

_WEBCAM_SENSOR = Sensor(blur=1.1, vignetting=0.25, shot_noise=8.0, read_noise=5.0, jpeg_quality=80)
_WEBCAM_REASONS = {
    "lens": "a field of 74 degrees, as usual for a webcam, and mild barrel distortion of a few per cent",
    "blur": "1.1 px: a plastic lens before small pixels, and demosaicing",
    "vignetting": "a quarter of the light is lost in the corners, as usual for small lenses",
    "noise": "a webcam in room light turns its gain up: 8 grey levels of shot noise at white, 5 of read noise",
    "squares": _PRINTED_REASON,
    "jpeg": "quality 80: webcams send motion JPEG of about this quality",
}

_TELELENS = BrownConrady(
    (2560, 1440), (3400.0, 3404.0), (38.0, -27.0), radial=(0.15, -0.1, 0.0), tangential=(1.5e-3, -1e-3)
)
_TELELENS_SENSOR = Sensor(blur=1.8, vignetting=0.45, shot_noise=8.0, read_noise=5.0, jpeg_quality=80)
_TELELENS_REASONS = _WEBCAM_REASONS | {
    "lens": "the webcam's focal length doubled by a clip-on lens: pincushion distortion as in telephoto lenses, and "
    "off centre because it is clipped on by hand",
    "blur": "1.8 px: the clip-on lens is softer than the webcam's own",
    "vignetting": "almost half: the two lenses' pupils do not match",
}

_MIRROR = Mirror(Pinhole((971, 871), 1380.0), distance=4.3, a=0.03, b=0.008, radius=4.0, tilt=25.0)
_MIRROR_SENSOR = Sensor(blur=1.0, vignetting=0.15, shot_noise=6.0, read_noise=4.0)
_MIRROR_REASONS = {
    "lens": "a D415's colour camera has 1380 px of focal length and hardly any distortion; 971x871 is a crop",
    "mirror": "squares of 6 cm: a mirror 26 cm before the camera, turned by 25 degrees so that the board can "
    "stand beside the camera; a = 0.03 is a radius of 1 m in the middle, and b = 0.008 more than doubles the "
    "slope towards the edges: flat in the middle, bulging outwards",
    "blur": "1.0 px: demosaicing, and the mirror's own surface",
    "vignetting": "0.15: the camera's own in the crop's corners",
    "noise": "a better camera than the webcam in the same light: 6 and 4 grey levels",
    "squares": _PRINTED_REASON,
    "jpeg": "none: its viewer stores PNG",
}


def _unity(name: str, title: str, lens: Lens) -> Dataset:
    return Dataset(name, title, lens, _WIDE, 30, _GAME_ENGINE, 1, _UNITY_REASONS, companions=_UNITY)


_PAPER = (
    _unity("unity-pinhole", "Unity pinhole", _UNITY[0]),
    _unity("unity-barrel", "Unity barrel", _UNITY[1]),
    _unity("unity-pincushion", "Unity pincushion", _UNITY[2]),
    Dataset("webcam", "Webcam", _WEBCAM, _WIDE, 11, _WEBCAM_SENSOR, 4, _WEBCAM_REASONS, _PRINTED),
    Dataset("webcam-telelens", "Webcam with telelens", _TELELENS, _TALL, 17, _TELELENS_SENSOR, 5,
            _TELELENS_REASONS, _PRINTED),
    Dataset("mirror", "RealSense with mirror", _MIRROR, _TALL, 26, _MIRROR_SENSOR, 6, _MIRROR_REASONS, _PRINTED),
)

DATASETS: dict[str, Dataset] = {dataset.name: dataset for dataset in _PAPER}
"""The paper's six data sets, in the order of its Table 1, with the paper's numbers of boards, corners and pixels."""
