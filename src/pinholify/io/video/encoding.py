"""The encoding of a straightened video: that of the original as far as possible."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from pinholify.errors import InputError, OutputError
from pinholify.io.video.encoders import ENCODERS, EVEN_ONLY, USUAL
from pinholify.io.video.planes import can_be_remapped
from pinholify.io.video.source import Colour, VideoInfo, pyav


@dataclass(frozen=True, slots=True)
class Encoding:
    """The complete settings of an encoder."""

    encoder: str
    options: tuple[tuple[str, str], ...]
    pixel_format: str
    size: tuple[int, int]
    time_base: Fraction
    rate: Fraction | None
    colour: Colour

    def configure(self, context: Any) -> None:
        """Apply the settings to PyAV's codec ``context``."""
        context.width, context.height = self.size
        context.pix_fmt = self.pixel_format
        context.time_base = self.time_base
        if self.rate is not None:
            context.framerate = self.rate
        context.options = dict(self.options)
        context.color_primaries, context.color_trc = self.colour.primaries, self.colour.transfer
        context.colorspace, context.color_range = self.colour.matrix, self.colour.range
        context.thread_type = "AUTO"
        context.flags |= pyav().codec.context.Flags.global_header  # required by all of CONTAINERS

    def open(self) -> Any:
        """Open a new encoder, ready for its first frame."""
        context = pyav().CodecContext.create(self.encoder, "w")
        self.configure(context)
        context.open()
        return context


def choose_encoding(
    info: VideoInfo, size: tuple[int, int], *, codec: str | None = None, quality: int | None = None
) -> Encoding:
    """The encoding of images of ``size`` made from a video with ``info``.

    The codec is that of the original if it can be written, otherwise H.264; the pixel format is that of the original if
    the encoder supports it, otherwise the nearest. ``quality`` is a constant rate factor: lower is better. Raises
    InputError for a ``quality`` that the codec does not have, and OutputError if FFmpeg lacks the encoder.
    """
    family = codec or (info.codec if info.codec in ENCODERS else USUAL)
    encoder = ENCODERS[family]
    if quality is not None and encoder.quality is None:
        raise InputError(f"{family} has no quality setting; omit the quality, or choose another codec")
    chosen = encoder.quality if quality is None else quality
    rate_factor = () if chosen is None else (("crf", str(chosen)),)
    pixel_format = _pixel_format(info.pixel_format, encoder.name, size)
    return Encoding(
        encoder.name,
        encoder.options + rate_factor,
        pixel_format,
        size,
        info.time_base,
        info.rate,
        _colour(info, pixel_format),
    )


def _pixel_format(original: str, encoder: str, size: tuple[int, int]) -> str:
    av = pyav()
    try:
        known = [kind.name for kind in av.codec.Codec(encoder, "w").video_formats]
    except av.codec.codec.UnknownCodecError:
        raise OutputError(f"this FFmpeg has no encoder {encoder}; choose another codec") from None
    # The formats yuvj… differ from yuv… only in their full range, which Colour represents.
    able = [name for name in known if can_be_remapped(name) and not name.startswith("yuvj")]
    if encoder in EVEN_ONLY:
        able = [name for name in able if _holds(name, size)]
    if not able:
        raise OutputError(
            f"{encoder} does not support images of {size[0]}x{size[1]}; choose a size with even sides, or another codec"
        )
    plain = original.replace("yuvj", "yuv")
    if plain in able:
        return plain
    nearest, _ = av.codec.codec.find_best_pix_fmt_of_list(able, plain)
    return str(nearest.name)


def _holds(pixel_format: str, size: tuple[int, int]) -> bool:
    """Whether the sides of an image are multiples of the colour subsampling of ``pixel_format``."""
    kind = pyav().VideoFormat(pixel_format, 64, 64)
    return all(size[0] % (64 // c.width) == 0 and size[1] % (64 // c.height) == 0 for c in kind.components)


def _colour(info: VideoInfo, pixel_format: str) -> Colour:
    """The colour of the original; RGB that is converted to YUV becomes BT.709 in limited range."""
    av = pyav()
    was_rgb, is_rgb = (av.VideoFormat(name, 64, 64).is_rgb for name in (info.pixel_format, pixel_format))
    return Colour(1, 1, 1, 1) if was_rgb and not is_rgb else info.colour
