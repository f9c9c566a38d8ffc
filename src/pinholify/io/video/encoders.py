"""The codecs and containers of straightened videos. Imports nothing heavy, so that ``--help`` is instant."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Encoder:
    """FFmpeg's encoder ``name`` and its ``options``; ``quality`` is its default constant rate factor, if it has one."""

    name: str
    quality: int | None
    options: tuple[tuple[str, str], ...] = ()


ENCODERS = {
    "h264": Encoder("libx264", 18),
    "hevc": Encoder("libx265", 20, (("x265-params", "log-level=error"),)),
    "vp9": Encoder("libvpx-vp9", 24, (("b", "0"), ("row-mt", "1"), ("deadline", "good"), ("cpu-used", "3"))),
    "av1": Encoder("libsvtav1", 24, (("preset", "8"),)),
    "prores": Encoder("prores_ks", None),
    "ffv1": Encoder("ffv1", None),
}
"""Codec → its encoder, at a quality hardly distinguishable from the original."""

USUAL = "h264"

CONTAINERS = (".mp4", ".m4v", ".mov", ".mkv", ".webm")
"""Endings of files that can be written: containers that store a time for every frame."""

EVEN_ONLY = ("libx264", "libx265", "libsvtav1", "prores_ks")
"""Encoders that subsample colour only in images with even sides."""
