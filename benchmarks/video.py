"""Video end to end against decoding, remapping and encoding done bare with the same libraries, in one run.

``python benchmarks/video.py [--size 1920x1080] [--frames 240] [--runs 3]``

The bare loops decode, call ``cv2.remap`` with maps made before, and encode with the same encoder and settings, without
threads of their own, parts, sound, or time stamps kept. One goes through BGR, as most scripts do; the other remaps the
planes as they are, as we do. A ratio above 1 means that we are faster.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

import av
import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from pinholify.batch.video import straighten_video, video_job
from pinholify.io.video.planes import frame_straightener
from pinholify.modes import cropped, scaled
from pinholify.rectification.maps import rectification_map, sampler
from pinholify.rectification.straightener import Straightener
from small_camera import quick_camera


def render(path, size, frames, pixel_format):
    """A video of a picture with detail that moves, with some noise."""
    rng = np.random.default_rng(0)
    big = cv2.GaussianBlur(rng.integers(0, 255, (size[1] + frames, size[0] + frames, 3), dtype=np.uint8), (0, 0), 3)
    big = cv2.normalize(big, None, 0, 255, cv2.NORM_MINMAX)
    noise = rng.integers(0, 6, (size[1], size[0], 3), dtype=np.uint8)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = *size, pixel_format
        stream.codec_context.options = {"crf": "20", "preset": "veryfast"}
        for i in range(frames):
            image = cv2.add(np.ascontiguousarray(big[i : i + size[1], i : i + size[0]]), np.roll(noise, 7 * i, axis=1))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, "bgr24")))
        container.mux(stream.encode(None))


def bare(source, target, encoding, straighten):
    """Decode, ``straighten``, encode, one after the other."""
    with av.open(str(source)) as original, av.open(str(target), "w") as output:
        video = original.streams.video[0]
        video.thread_type = "AUTO"
        stream = output.add_stream(encoding.encoder, rate=video.average_rate)
        encoding.configure(stream.codec_context)
        for frame in original.decode(video):
            output.mux(stream.encode(straighten(frame)))
        output.mux(stream.encode(None))


def through_bgr(rectification, image_size, encoding):
    maps = sampler(rectification, image_size, fixed_point=True)

    def straighten(frame):
        image = frame.to_ndarray(format="bgr48le" if "10" in encoding.pixel_format else "bgr24")
        out = av.VideoFrame.from_ndarray(
            cv2.remap(image, maps.map1, maps.map2, cv2.INTER_CUBIC), "bgr48le" if image.dtype == np.uint16 else "bgr24"
        ).reformat(format=encoding.pixel_format)
        out.pts, out.time_base = frame.pts, frame.time_base
        return out

    return straighten


def seconds(function):
    start = time.perf_counter()
    function()
    return time.perf_counter() - start


def fixed_point_error(rectification, image_size, frame):
    """Levels by which fixed-point maps change a frame's brightness against maps of float: RMS and largest."""
    luma = frame.to_ndarray(format="gray")
    exact = sampler(rectification, image_size)(luma.astype(np.float32))
    error = (sampler(rectification, image_size, fixed_point=True)(luma) - np.clip(np.rint(exact), 0, 255)).ravel()
    return float(np.sqrt((error**2).mean())), float(np.abs(error).max())


def compare(size, frames, runs, pixel_format):
    width = round(size[1] * 4 / 3)  # the small camera's proportions, then the size's
    whole = scaled(quick_camera(), (max(size[0], width), round(max(size[0], width) * 3 / 4)))
    camera = cropped(whole, 0, (whole.image_size[1] - size[1]) // 2, size)
    straightener = Straightener(camera)
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "in.mp4", Path(folder) / "out.mp4"
        render(source, size, frames, pixel_format)
        job = video_job(straightener, str(source), str(target))
        rectification = rectification_map(camera, straightener.view)
        ways = {
            "ours": lambda: straighten_video(straightener, job),
            "bare, BGR": lambda: bare(source, target, job.encoding, through_bgr(rectification, size, job.encoding)),
            "bare, planes": lambda: bare(
                source, target, job.encoding, frame_straightener(rectification, size, pixel_format, full_range=False)
            ),
        }
        times = {name: [] for name in ways}
        for _ in range(runs):
            for name, way in ways.items():
                times[name].append(seconds(way))
        best = {name: min(values) for name, values in times.items()}
        middle = {name: statistics.median(values) for name, values in times.items()}
        with av.open(str(source)) as container:
            rms, largest = fixed_point_error(rectification, size, next(container.decode(video=0)))
    print(f"{size[0]}x{size[1]}, {pixel_format}, {frames} frames, {job.encoding.encoder}, best (median) of {runs}")
    for name in list(ways)[1:]:
        print(f"  {name:13s} / ours: {best[name] / best['ours']:.2f} ({middle[name] / middle['ours']:.2f})")
    print(f"  fixed-point maps change brightness by {rms:.3f} levels RMS, {largest:.0f} at most")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", default="1920x1080")
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--format", default="yuv420p")
    options = parser.parse_args()
    size = tuple(map(int, options.size.split("x")))
    compare(size, options.frames, options.runs, options.format)


if __name__ == "__main__":
    main()
