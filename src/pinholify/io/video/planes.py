"""Remapping of video frames plane by plane: luma and chroma keep their bit depth, range and subsampling.

No frame is converted to RGB. A subsampled plane has its own map, derived from that of the full planes; chroma samples
are assumed to lie at the left of their pixels and midway between their rows, H.264's default (ITU-T H.264 E.2.1, chroma
sample location type 0).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pinholify.io.video.source import Frame, pyav
from pinholify.rectification.maps import RectificationMap, Sampler, sampler

FULL_RANGE = 2  # in an AVFrame's color_range

Plane = NDArray[Any]


@dataclass(frozen=True, slots=True)
class PlaneKind:
    """The samples of a plane: subsampling (columns, rows), bits, and the value of black or of neutral chroma."""

    subsampling: tuple[int, int]
    bits: int
    black: int


def plane_kinds(pixel_format: str, *, full_range: bool) -> list[PlaneKind]:
    """The planes of ``pixel_format`` (FFmpeg's name), in storage order."""
    kind = pyav().VideoFormat(pixel_format, 64, 64)
    planes: dict[int, PlaneKind] = {}
    for component in kind.components:
        middle, floor = 1 << (component.bits - 1), 0 if full_range or kind.is_rgb else 1 << (component.bits - 4)
        black = middle if component.is_chroma and not kind.is_rgb else floor
        planes[component.plane] = PlaneKind((64 // component.width, 64 // component.height), component.bits, black)
    return [planes[i] for i in sorted(planes)]


def can_be_remapped(pixel_format: str) -> bool:
    """Whether ``pixel_format`` has one plane per component, of little-endian integers."""
    kind = pyav().VideoFormat(pixel_format, 64, 64)
    components = kind.components
    alone = len({c.plane for c in components}) == len(components) in (1, 3)
    plain = not (kind.has_palette or kind.is_bayer or kind.is_bit_stream or kind.is_big_endian or "f" in kind.name)
    return alone and plain and all(8 <= c.bits <= 16 for c in components)


@dataclass(frozen=True, slots=True, eq=False)
class FrameStraightener:
    """Remaps frames of ``pixel_format`` to frames of ``size`` (width, height), plane by plane."""

    size: tuple[int, int]
    pixel_format: str
    planes: tuple[tuple[PlaneKind, Sampler], ...]

    def __call__(self, frame: Frame) -> Frame:
        """The straightened frame, with the time and colour description of ``frame``."""
        out = pyav().VideoFrame(*self.size, self.pixel_format)
        for source, target, (kind, to_view) in zip(frame.planes, out.planes, self.planes, strict=True):
            _remap(_samples(source, kind), to_view, _samples(target, kind), kind)
        out.pts, out.time_base, out.duration = frame.pts, frame.time_base, frame.duration
        for name in ("color_range", "colorspace", "color_primaries", "color_trc"):
            setattr(out, name, getattr(frame, name))
        return out


def frame_straightener(
    rectification: RectificationMap, image_size: tuple[int, int], pixel_format: str, *, full_range: bool
) -> FrameStraightener:
    """The straightener from frames of ``image_size`` (width, height) to the view of ``rectification``.

    Its maps are fixed-point, with a resolution of 1/32 px.
    """
    kinds = plane_kinds(pixel_format, full_range=full_range)
    samplers = {step: _plane_sampler(rectification, image_size, step) for step in {k.subsampling for k in kinds}}
    planes = tuple((kind, samplers[kind.subsampling]) for kind in kinds)
    return FrameStraightener(rectification.view.size, pixel_format, planes)


def _samples(plane: Any, kind: PlaneKind) -> Plane:
    """The samples (height, width) of a plane, without copying."""
    dtype = np.dtype(np.uint8 if kind.bits == 8 else np.uint16)
    rows = np.frombuffer(plane, dtype)[: plane.height * (plane.line_size // dtype.itemsize)]
    return rows.reshape(plane.height, -1)[:, : plane.width]


def _remap(source: Plane, to_view: Sampler, target: Plane, kind: PlaneKind) -> None:
    target[:] = kind.black
    cv2.remap(source, to_view.map1, to_view.map2, cv2.INTER_CUBIC, dst=target, borderMode=cv2.BORDER_TRANSPARENT)
    if kind.bits not in (8, 16):  # OpenCV clips the overshoot of cubic interpolation to the range of the dtype only
        np.minimum(target, (1 << kind.bits) - 1, out=target)


def _plane_sampler(rectification: RectificationMap, image_size: tuple[int, int], step: tuple[int, int]) -> Sampler:
    """The sampler of a plane with one sample per ``step`` = (columns, rows) pixels."""
    if step == (1, 1):
        return sampler(rectification, image_size, fixed_point=True)
    columns, rows = step
    blocks = _blocks(rectification.uv, step)
    left = blocks[:, :, :, 0]  # (height, rows, width, 2)
    with np.errstate(invalid="ignore"):
        known = np.isfinite(left)
        uv = np.where(known, left, 0).sum(axis=1) / known.sum(axis=1)
    uv[..., 1] -= (rows - 1) / 2.0
    plane_map = replace(
        rectification,
        uv=(uv / step).astype(np.float32),
        valid=_blocks(rectification.valid, step).any(axis=(1, 3)) & np.isfinite(uv).all(axis=-1),
    )
    return sampler(plane_map, (-(-image_size[0] // columns), -(-image_size[1] // rows)), fixed_point=True)


def _blocks(values: NDArray[Any], step: tuple[int, int]) -> NDArray[Any]:
    """Split (height, width, …) into blocks (height/rows, rows, width/columns, columns, …), padded by extrapolation."""
    columns, rows = step
    pad = [(0, -values.shape[0] % rows), (0, -values.shape[1] % columns)] + [(0, 0)] * (values.ndim - 2)
    padded = np.pad(values, pad, "edge") if values.dtype == bool else np.pad(values, pad, "reflect", reflect_type="odd")
    height, width = padded.shape[:2]
    return padded.reshape(height // rows, rows, width // columns, columns, *values.shape[2:])
