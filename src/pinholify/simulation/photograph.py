"""The sensor: blur, vignetting, noise, quantisation to eight bits, JPEG compression."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter


@dataclass(frozen=True, slots=True)
class Sensor:
    """Parameters by which a rendered image becomes a photograph.

    ``blur``: standard deviation of the Gaussian blur of lens and demosaicing, px. ``vignetting``: share of the light
    lost in the image's corners. ``shot_noise``: standard deviation at white, proportional to the square root of the
    light; ``read_noise``: standard deviation at black; both in grey levels of 255. ``jpeg_quality``: 1 … 95, or None
    for a lossless file.
    """

    blur: float = 0.7
    vignetting: float = 0.0
    shot_noise: float = 0.0
    read_noise: float = 0.0
    jpeg_quality: int | None = None


def photograph(
    image: NDArray[np.float32], sensor: Sensor, seed: int | tuple[int, ...] = 0
) -> NDArray[np.uint8]:
    """The uint8 photograph that ``sensor`` takes of ``image`` (h, w) or (h, w, 3), 0 … 1, with noise from ``seed``."""
    light = gaussian_filter(image, (sensor.blur, sensor.blur, 0)[: image.ndim], mode="nearest")
    light *= _vignette(image.shape[:2], sensor.vignetting).reshape(image.shape[:2] + (1,) * (image.ndim - 2))
    noisy = _with_noise(light, sensor, np.random.default_rng(seed))
    eight_bit = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return eight_bit if sensor.jpeg_quality is None else through_jpeg(eight_bit, sensor.jpeg_quality)


def _vignette(shape: tuple[int, ...], lost: float) -> NDArray[np.float32]:
    """Share (h, w) of the light that arrives; the loss grows with the square of the distance from the centre."""
    v, u = (np.linspace(-1, 1, n, dtype=np.float32) ** 2 / 2 for n in shape)
    return np.asarray(1 - np.float32(lost) * (v[:, None] + u[None, :]))


def _with_noise(light: NDArray[np.float32], sensor: Sensor, rng: np.random.Generator) -> NDArray[np.float32]:
    levels = 255 * light
    if sensor.shot_noise == 0 and sensor.read_noise == 0:
        return levels
    deviation = np.sqrt(np.float32(sensor.read_noise**2) + np.float32(sensor.shot_noise**2) * light)
    return np.asarray(levels + deviation * rng.standard_normal(levels.shape, dtype=np.float32))


def through_jpeg(image: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """``image`` (h, w) grey or (h, w, 3) RGB after JPEG compression at ``quality`` (1 … 95)."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=quality)
    with Image.open(file) as decoded:
        return np.asarray(decoded)
