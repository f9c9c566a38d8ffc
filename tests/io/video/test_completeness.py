"""Videos that were cut short are told from whole ones, of any frame rate, and from those that tell no length."""

from __future__ import annotations

import numpy as np
import pytest

from videos import make_video

av = pytest.importorskip("av", reason="needs the extra 'video'")

from pinholify.io.video.completeness import Shortfall, shortfall  # noqa: E402
from pinholify.io.video.source import frames  # noqa: E402

COUNT = 90
STEADY = list(range(0, COUNT * 1001, 1001))
UNSTEADY = np.cumsum(np.random.default_rng(0).integers(500, 6000, COUNT)).tolist()


def again(source, target, options):
    """The same packets in another file."""
    with av.open(str(source)) as original, av.open(str(target), "w", container_options=options) as copy:
        streams = {s.index: copy.add_stream_from_template(s) for s in original.streams}
        for packet in original.demux():
            if packet.size:
                packet.stream = streams[packet.stream_index]
                copy.mux(packet)
    return target


def cut(path, share):
    """The file's first part."""
    data = path.read_bytes()
    short = path.with_name(f"cut-{path.name}")
    short.write_bytes(data[: int(len(data) * share)])
    return str(short)


KINDS = {
    "its index first": ("clip.mp4", {"movflags": "+faststart"}),
    "mkv": ("clip.mkv", {}),
    "no length": ("clip.mkv", {"live": "1"}),
    "in fragments": ("clip.mp4", {"movflags": "frag_keyframe+empty_moov"}),
    "ts": ("clip.ts", {}),
}


@pytest.fixture(params=KINDS)
def made(request, tmp_path):
    def make(times, sound):
        make_video(tmp_path / "made.mp4", (96, 64), times, sound=sound)
        name, options = KINDS[request.param]
        return again(tmp_path / "made.mp4", tmp_path / name, options), request.param

    return make


@pytest.mark.parametrize("sound", [False, True])
@pytest.mark.parametrize("times", [STEADY, UNSTEADY], ids=["steady", "unsteady"])
def test_half_a_video_lacks_the_rest_and_a_whole_one_nothing(made, times, sound):
    path, kind = made(times, sound)
    assert shortfall(str(path)) is None
    short = cut(path, 0.5)
    lacking = shortfall(short)
    if kind in ("its index first", "mkv"):
        assert lacking is not None
        assert lacking.declared == pytest.approx(COUNT, rel=0.05 if times is STEADY else 0.15)
        assert lacking.found == pytest.approx(len(list(frames(short))), abs=4)
        assert lacking.found < 0.7 * COUNT
    elif kind != "in fragments":  # whose last one may be whole or not
        assert lacking is None  # nothing tells how long it was
    assert 0 < len(list(frames(short))) < 0.75 * COUNT


def test_a_trimmed_video_lacks_nothing(tmp_path):
    """Its frames before the start are in the file but for no one to see."""
    make_video(tmp_path / "a.mp4", (96, 64), STEADY)
    with av.open(str(tmp_path / "a.mp4")) as original, av.open(str(tmp_path / "b.mp4"), "w") as copy:
        stream = original.streams.video[0]
        to = copy.add_stream_from_template(stream)
        for packet in original.demux(stream):
            if packet.size:
                packet.stream, packet.pts, packet.dts = to, packet.pts - 17 * 1001, packet.dts - 17 * 1001
                copy.mux(packet)
    assert len(list(frames(str(tmp_path / "b.mp4")))) < COUNT
    assert shortfall(str(tmp_path / "b.mp4")) is None


def test_sound_that_goes_on_lacks_no_picture(tmp_path):
    make_video(tmp_path / "short.mp4", (96, 64), STEADY[:30])
    make_video(tmp_path / "long.mp4", (96, 64), STEADY, sound=True)
    for target in ("both.mkv", "both.mp4"):
        with (
            av.open(str(tmp_path / "short.mp4")) as one,
            av.open(str(tmp_path / "long.mp4")) as two,
            av.open(str(tmp_path / target), "w") as copy,
        ):
            pairs = [(one, one.streams.video[0]), (two, two.streams.audio[0])]
            streams = [copy.add_stream_from_template(stream) for _, stream in pairs]
            for (container, stream), to in zip(pairs, streams, strict=True):
                for packet in container.demux(stream):
                    if packet.size:
                        packet.stream = to
                        copy.mux(packet)
        assert shortfall(str(tmp_path / target)) is None


def test_a_damaged_avi_is_counted(tmp_path):
    with av.open(str(tmp_path / "a.avi"), "w") as container:
        stream = container.add_stream("mjpeg", rate=30)
        stream.width, stream.height, stream.pix_fmt = 96, 64, "yuvj420p"
        for number in range(60):
            picture = np.full((64, 96, 3), 4 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture)))
        container.mux(stream.encode(None))
    assert shortfall(str(tmp_path / "a.avi")) is None
    lacking = shortfall(cut(tmp_path / "a.avi", 0.5))
    assert lacking is not None
    assert lacking.declared == 60


def test_the_sentence_says_how_much_there_is():
    assert Shortfall(150, 288).of("a.mp4") == (
        "'a.mp4' ends early: 150 of about 288 frames are there; it was cut short or is damaged: copy it again"
    )


