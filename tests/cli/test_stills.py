"""Videos where photographs are wanted: sharp frames of them, each different from the last."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from pinholify.io.images import read_image

av = pytest.importorskip("av", reason="needs the extra 'video'")

from pinholify.io.video.choice import choose_stills  # noqa: E402

AROUND = 8
"""Frames of each photograph: the fourth one is sharp."""


@pytest.fixture(scope="session")
def clip(photographs, tmp_path_factory):
    """Every photograph for eight frames, blurred by motion but in the fourth; the fourth photograph is shown twice."""
    path = tmp_path_factory.mktemp("clip") / "clip.mp4"
    names = [0, 1, 2, 3, 3, 4, 5, 6]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.width, stream.height, stream.pix_fmt = 640, 480, "yuv420p"
        stream.codec_context.options = {"crf": "8"}
        for name in names:
            image = read_image(photographs / f"small-{name:02d}.png")
            for i in range(AROUND):
                blurred = cv2.blur(image, (1 + 8 * abs(i - 3), 1))
                container.mux(stream.encode(av.VideoFrame.from_ndarray(blurred, "gray").reformat(format="yuv420p")))
        container.mux(stream.encode(None))
    return path


def test_sharp_and_different_frames_are_chosen(clip, photographs):
    seen = []
    stills = list(choose_stills(str(clip), count=8, on_frame=lambda: seen.append(1)))
    assert len(seen) == 64
    assert [still.number for still in stills] == [3, 11, 19, 27, 43, 51, 59]
    for name, still in enumerate(stills):
        truth = read_image(photographs / f"small-{name:02d}.png").astype(float)
        slope, level = np.polyfit(truth.ravel(), still.image.ravel(), 1)
        assert np.abs(slope * truth + level - still.image).mean() < 2


def test_fewer_parts_give_fewer_frames(clip):
    assert len(list(choose_stills(str(clip), count=2))) == 2


def test_detect_takes_a_video_among_photographs(run, clip, photographs):
    found = json.loads(run("detect", clip, photographs / "small-00.png", "--board", "9x6", "--json").out)
    names = [image["file"] for image in found["images"]]
    assert names[0] == "clip-000003.png"
    assert names[-1] == "small-00.png"
    boards = {image["file"]: image["corners"] for image in found["images"] if image["found"]}
    assert boards["clip-000003.png"] == boards["small-00.png"] == 54


def test_of_half_a_video_the_rest_is_missed(run, clip):
    with av.open(str(clip)) as original, av.open("whole.mkv", "w") as copy:
        stream = copy.add_stream_from_template(original.streams.video[0])
        for packet in original.demux(original.streams.video[0]):
            if packet.size:
                packet.stream = stream
                copy.mux(packet)
    data = Path("whole.mkv").read_bytes()
    Path("half.mkv").write_bytes(data[: len(data) // 2])
    result = run("detect", "half.mkv", "--board", "9x6", "--json")
    assert result.status == 0  # what there is counts
    assert "note: 'half.mkv' ends early: " in result.err
    assert "ends early" not in run("detect", "whole.mkv", "--board", "9x6", "--json").err


def test_two_videos_of_one_name(refused, clip):
    Path("clip.mp4").write_bytes(clip.read_bytes())
    result = refused("detect", clip, "clip.mp4", "--board", "9x6")
    assert "two videos are called 'clip'" in result


@pytest.mark.slow
def test_calibrate_from_a_video(run, clip):
    words = ["--board", "9x6", "--no-opencv", "--no-heldout", "--json"]
    result = run("calibrate", clip, *words)
    assert result.status == 0
    assert json.loads(result.out)["re_px"] < 1.0
