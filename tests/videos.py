"""Small videos that tests render, and what is in a video file."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np

TIME_BASE = Fraction(1, 30000)
RATE = Fraction(30000, 1001)


def picture(number, size, bits=8):
    """Planes (Y, U, V) of a smooth pattern that moves, full size, as float."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    scale = 1 << (bits - 8)
    luma = 126 + 90 * np.sin(x / 7.0 + number / 3) * np.cos(y / 9.0)
    return [scale * luma, scale * (128 + 60 * np.sin(x / 30)), scale * (128 + 60 * np.cos(y / 30))]


def frame_of(number, size, pixel_format):
    import av

    frame = av.VideoFrame(*size, pixel_format)
    frame.time_base = TIME_BASE
    bits = frame.format.components[0].bits
    for plane, values in zip(frame.planes, picture(number, size, bits), strict=False):
        step = round(size[0] / plane.width), round(size[1] / plane.height)
        dtype = np.uint8 if bits == 8 else np.uint16
        rows = np.frombuffer(plane, dtype).reshape(plane.height, -1)
        rows[:, : plane.width] = np.rint(values[:: step[1], :: step[0]])
    return frame


def make_video(
    path: Path, size, times, *, pixel_format="yuv420p", codec="libx264", sound=False, rotation=0, colour=(1, 1, 1, 1)
):
    """A video with a frame at each of ``times`` (multiples of TIME_BASE), each shown until the next."""
    import av

    exact = {"movie_timescale": "30000"} if path.suffix == ".mp4" else {}  # or the start is rounded to a millisecond
    with av.open(str(path), "w", container_options=exact) as container:
        video = container.add_stream(codec, rate=RATE)
        video.width, video.height, video.pix_fmt = *size, pixel_format
        context = video.codec_context
        context.time_base = video.time_base = TIME_BASE
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = colour
        if codec == "libx264":
            context.options = {"g": "12", "crf": "12", "bf": "3"}
        if rotation:
            video.set_display_rotation(rotation)
        audio = _add_sound(container) if sound else None
        lengths = np.diff(times, append=times[-1] + 1001).tolist()
        for number, (time, length) in enumerate(zip(times, lengths, strict=True)):
            frame = frame_of(number, size, pixel_format)
            frame.pts, frame.time_base, frame.duration = time, TIME_BASE, length
            container.mux(video.encode(frame))
        container.mux(video.encode(None))
        if audio is not None:
            _fill_sound(container, audio, seconds=float(times[-1] * TIME_BASE))


def _add_sound(container):
    stream = container.add_stream("aac", rate=44100)
    stream.layout = "mono"
    return stream


def _fill_sound(container, stream, seconds):
    import av

    for start in range(0, int(44100 * seconds) + 1024, 1024):
        wave = np.sin(np.arange(start, start + 1024) / 20.0).astype(np.float32)[None]
        frame = av.AudioFrame.from_ndarray(wave, format="fltp", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = 44100, start, Fraction(1, 44100)
        container.mux(stream.encode(frame))
    container.mux(stream.encode(None))


def packets(path, kind):
    """(time in s, length in s, bytes) of each packet of the first stream of ``kind``, in the order of decoding."""
    import av

    with av.open(str(path)) as container:
        stream = next(s for s in container.streams if s.type == kind)
        found = [p for p in container.demux(stream) if p.size]
        return [(p.pts * p.time_base, p.duration * p.time_base, bytes(p)) for p in found]


def decoded(path):
    """All frames of a video."""
    import av

    with av.open(str(path)) as container:
        return list(container.decode(container.streams.video[0]))


def plane(frame, number):
    """A plane of a frame as an array (height, width)."""
    p = frame.planes[number]
    dtype = np.uint8 if frame.format.components[0].bits == 8 else np.uint16
    return np.frombuffer(p, dtype).reshape(p.height, -1)[:, : p.width].copy()
