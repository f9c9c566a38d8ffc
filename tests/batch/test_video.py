"""Videos end to end: every frame at its time and in its depth, the sound untouched, and nothing done twice."""

from __future__ import annotations

import shutil
import subprocess
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from pinholify.errors import ImageError, InputError, OutputError
from pinholify.rectification.options import ViewOptions
from pinholify.rectification.straightener import Straightener
from videos import TIME_BASE, decoded, make_video, packets, plane

av = pytest.importorskip("av", reason="needs the extra 'video'")

from pinholify.batch import video as batch_video  # noqa: E402
from pinholify.batch.video import straighten_video, video_job  # noqa: E402
from pinholify.io.video import source as video_source  # noqa: E402

SIZE = (96, 72)
STEADY = list(range(0, 40 * 1001, 1001))
UNSTEADY = np.cumsum(np.random.default_rng(0).integers(300, 4000, 40)).tolist()


def run(straightener, source, target="out.mp4", **options):
    return straighten_video(straightener, video_job(straightener, str(source), str(target), **options))


def times(path):
    return [frame.pts * frame.time_base for frame in decoded(path)]


@pytest.fixture(autouse=True)
def in_small_parts(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(batch_video, "SEGMENT", 9)


@pytest.mark.parametrize("moments", [STEADY, UNSTEADY], ids=["steady", "unsteady"])
@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_every_frame_is_there_at_its_time_and_the_sound_as_it_was(straightener, moments, suffix):
    make_video(Path("in.mp4"), SIZE, moments, sound=True)
    assert run(straightener, "in.mp4", f"out{suffix}") == 40
    assert times(f"out{suffix}") == times("in.mp4")
    assert np.diff(times("in.mp4")).tolist() == [step * TIME_BASE for step in np.diff(moments).tolist()]
    assert packets(f"out{suffix}", "video")[-1][1] == packets("in.mp4", "video")[-1][1] or moments is UNSTEADY
    assert packets(f"out{suffix}", "audio") == packets("in.mp4", "audio")
    assert sorted(p.name for p in Path().iterdir()) == sorted(["in.mp4", f"out{suffix}"])


def test_matroska_rounds_times_to_its_milliseconds(straightener):
    make_video(Path("in.mp4"), SIZE, UNSTEADY, sound=True)
    assert run(straightener, "in.mp4", "out.mkv") == 40
    late = [a - b for a, b in zip(times("out.mkv"), times("in.mp4"), strict=True)]
    late_sound = packets("out.mkv", "audio")[0][0] - packets("in.mp4", "audio")[0][0]
    assert max(*late, late_sound) - min(*late, late_sound) <= Fraction(1, 1000)


@pytest.mark.parametrize(("pixel_format", "bits"), [("yuv420p", 8), ("yuv420p10le", 10), ("yuv444p10le", 10)])
def test_the_picture_is_the_straight_one_in_its_own_depth(straightener, pixel_format, bits):
    make_video(Path("in.mp4"), SIZE, STEADY[:12], pixel_format=pixel_format)
    run(straightener, "in.mp4", quality=4)
    for before, after in zip(decoded("in.mp4"), decoded("out.mp4"), strict=True):
        assert after.format.name == pixel_format
        straight = straightener(plane(before, 0)).astype(float)
        shown = straightener(np.full(SIZE[::-1], 255, np.uint8)) > 0
        error = (plane(after, 0) - straight)[shown] / (1 << (bits - 8))
        assert np.sqrt((error**2).mean()) < 1.5
        assert np.abs(plane(after, 0)[~shown] / (1 << (bits - 8)) - 16).mean() < 2
    if bits == 10:
        assert (plane(decoded("out.mp4")[0], 0) % 4).any()


@pytest.mark.parametrize("colour", [(1, 1, 1, 1), (9, 16, 9, 1), (1, 13, 1, 2), (2, 2, 2, 0)])
def test_colours_mean_what_they_meant(straightener, colour):
    make_video(Path("in.mp4"), SIZE, STEADY[:5], colour=colour)
    run(straightener, "in.mp4")
    named = [(f.color_primaries, f.color_trc, f.colorspace, f.color_range) for f in map(first, ("in.mp4", "out.mp4"))]
    assert named[0] == named[1]


def first(path):
    return decoded(path)[0]


@pytest.mark.parametrize("rotation", [90, 180, 270])
def test_rotation_stays_in_the_metadata_and_out_of_the_picture(straightener, rotation):
    make_video(Path("in.mp4"), SIZE, STEADY[:5], rotation=rotation)
    run(straightener, "in.mp4")
    assert first("out.mp4").rotation == first("in.mp4").rotation != 0
    assert (first("out.mp4").width, first("out.mp4").height) == SIZE


@pytest.mark.parametrize(
    ("size", "codec", "pixel_format"),
    [((96, 72), "h264", "yuv420p"), ((81, 55), "h264", "yuv444p"), ((81, 55), "ffv1", "yuv420p"),
     ((81, 55), "vp9", "yuv420p"), ((81, 56), "hevc", "yuv444p"), ((80, 56), "prores", "yuv422p10le")],
)  # fmt: skip
def test_views_of_any_size(straightener, size, codec, pixel_format):
    make_video(Path("in.mp4"), SIZE, STEADY[:12])
    assert run(Straightener(straightener.camera, ViewOptions(size=size)), "in.mp4", "out.mkv", codec=codec) == 12
    frames = decoded("out.mkv")
    assert len(frames) == 12
    assert {(f.width, f.height, f.format.name) for f in frames} == {(*size, pixel_format)}


@pytest.mark.parametrize(("codec", "expected"), [("mpeg4", "h264"), ("libx265", "hevc"), ("ffv1", "ffv1")])
def test_the_codec_is_the_originals_where_it_can_be(straightener, codec, expected):
    make_video(Path("in.mkv"), SIZE, STEADY[:5], codec=codec)
    run(straightener, "in.mkv", "out.mkv")
    with av.open("out.mkv") as container:
        assert container.streams.video[0].codec_context.codec.canonical_name == expected


def test_rgb_becomes_bt709(straightener):
    make_video(Path("in.mkv"), SIZE, STEADY[:5], codec="libx264rgb", pixel_format="rgb24", colour=(1, 13, 0, 2))
    run(straightener, "in.mkv", codec="h264")
    assert (int(first("out.mp4").colorspace), int(first("out.mp4").color_range)) == (1, 1)


class Stop(Exception):
    pass


def stop_after(count):
    seen = []

    def on_frame():
        seen.append(1)
        if len(seen) == count:
            raise Stop

    return on_frame


@pytest.mark.parametrize("moments", [STEADY, UNSTEADY], ids=["steady", "unsteady"])
@pytest.mark.parametrize("seekable", [True, False])
def test_a_run_that_is_stopped_goes_on_from_its_last_whole_part(straightener, moments, seekable, monkeypatch):
    make_video(Path("in.mp4"), SIZE, moments, sound=True)
    job = video_job(straightener, "in.mp4", "out.mp4")
    with pytest.raises(Stop):
        straighten_video(straightener, job, on_frame=stop_after(30))
    assert not Path("out.mp4").exists()
    parts = {path: path.stat().st_mtime_ns for path in job.parts.iterdir()}
    assert len(parts) == 3
    if not seekable:
        monkeypatch.setattr(video_source, "_sought", lambda *_: None)
    read = []
    timed = video_source._timed
    monkeypatch.setattr(video_source, "_timed", lambda *words: (read.append(f.pts) or f for f in timed(*words)))
    monkeypatch.setattr(batch_video.SegmentFolder, "remove", lambda self: None)
    seen = []
    again = video_job(straightener, "in.mp4", "out.mp4")
    assert straighten_video(straightener, again, on_frame=lambda: seen.append(1)) == len(seen) == 40
    assert {path: path.stat().st_mtime_ns for path in parts} == parts
    assert (len(read) < 40) == seekable
    assert times("out.mp4") == times("in.mp4")
    assert packets("out.mp4", "audio") == packets("in.mp4", "audio")
    for before, after in zip(decoded("in.mp4"), decoded("out.mp4"), strict=True):
        straight = np.maximum(straightener(plane(before, 0)), 16.0)  # black, in limited range
        assert np.abs(plane(after, 0) - straight).mean() < 2


def test_parts_of_another_view_or_video_are_not_taken(straightener):
    make_video(Path("in.mp4"), SIZE, STEADY[:20])
    job = video_job(straightener, "in.mp4", "out.mp4")
    others = [
        video_job(Straightener(straightener.camera, ViewOptions("board")), "in.mp4", "out.mp4"),
        video_job(straightener, "in.mp4", "out.mp4", quality=30),
        video_job(straightener, "in.mp4", "out.mp4", codec="hevc"),
    ]
    make_video(Path("in.mp4"), SIZE, STEADY[:21])
    others.append(video_job(straightener, "in.mp4", "out.mp4"))
    assert len({j.parts for j in [job, *others]}) == 5


def test_a_part_that_is_damaged_is_done_again(straightener):
    make_video(Path("in.mp4"), SIZE, STEADY)
    job = video_job(straightener, "in.mp4", "out.mp4")
    with pytest.raises(Stop):
        straighten_video(straightener, job, on_frame=stop_after(30))
    broken = sorted(job.parts.iterdir())[1]
    broken.write_bytes(broken.read_bytes()[:200])
    assert straighten_video(straightener, job) == 40
    assert times("out.mp4") == times("in.mp4")


def test_frames_without_times_get_them(straightener):
    make_video(Path("in.h264"), SIZE, STEADY[:20])
    assert run(straightener, "in.h264") == 20
    moments = times("out.mp4")
    assert len(set(np.diff(np.array(moments, dtype=float)).round(4))) == 1


def test_what_cannot_be_done_is_said_before_any_work(straightener, monkeypatch):
    make_video(Path("in.mp4"), SIZE, STEADY[:3], sound=True)
    make_video(Path("other.mp4"), (64, 48), STEADY[:3])
    Path("text.mp4").write_text("no video\n")
    monkeypatch.setattr(batch_video, "straighten_video", None)
    for error, words, options in [
        (ImageError, ("other.mp4", "out.mp4"), {}),
        (ImageError, ("text.mp4", "out.mp4"), {}),
        (ImageError, ("none.mp4", "out.mp4"), {}),
        (OutputError, ("in.mp4", "out.png"), {}),
        (OutputError, ("in.mp4", "out.webm"), {}),
        (OutputError, ("in.mp4", "none/out.mp4"), {}),
        (InputError, ("in.mp4", "out.mkv"), {"codec": "ffv1", "quality": 3}),
    ]:
        with pytest.raises(error):
            video_job(straightener, *words, **options)
    with pytest.raises(InputError, match="by 'remap' only"):
        video_job(Straightener(straightener.camera, method="splat"), "in.mp4", "out.mp4")
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(InputError, match=r"pip install 'pinholify\[video\]'"):
        video_job(straightener, "in.mp4", "out.mp4")
    assert sorted(p.name for p in Path().iterdir()) == ["in.mp4", "other.mp4", "text.mp4"]


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="needs ffmpeg")
def test_interlaced_video_is_refused(straightener):
    make_video(Path("in.mp4"), SIZE, STEADY[:5])
    words = ["-vf", "setfield=tff", "-flags", "+ildct+ilme", "-c:v", "mpeg2video", "fields.mpg"]
    subprocess.run(["ffmpeg", "-v", "error", "-i", "in.mp4", *words], check=True)
    with pytest.raises(ImageError, match="is interlaced"):
        video_job(straightener, "fields.mpg", "out.mp4")


@pytest.mark.skipif(shutil.which("ffprobe") is None, reason="needs ffprobe")
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv420p10le"])
def test_ffmpeg_reads_the_same(straightener, pixel_format):
    make_video(Path("in.mp4"), SIZE, UNSTEADY, sound=True, pixel_format=pixel_format, rotation=90)
    run(straightener, "in.mp4")
    streams = "stream=codec_name,pix_fmt,width,height,nb_read_frames,time_base,start_pts,color_range,color_space,"
    for shown in (streams + "color_transfer,color_primaries:stream_side_data=rotation", "frame=media_type,pts"):
        assert probed("out.mp4", shown) == probed("in.mp4", shown)


def probed(path, shown):
    words = ["ffprobe", "-v", "error", "-count_frames", "-show_entries", shown, "-of", "csv", path]
    lines = subprocess.run(words, check=True, capture_output=True, text=True).stdout.splitlines()
    return sorted(line.split(",side_data")[0] for line in lines if line)


def test_command(straightener, tmp_path, capsys):
    from pinholify.cli.video import straighten_one_video

    make_video(Path("in.mp4"), SIZE, STEADY[:12], sound=True)
    words = {"codec": None, "quality": None, "force": False, "as_json": False}
    straighten_one_video(straightener, ["in.mp4"], "out.mp4", **words)
    assert capsys.readouterr().out == "wrote out.mp4: 12 frames\n"
    with pytest.raises(OutputError, match="is already there"):
        straighten_one_video(straightener, ["in.mp4"], "out.mp4", **words)
    with pytest.raises(OutputError, match="is one of the inputs"):
        straighten_one_video(straightener, ["in.mp4"], "in.mp4", **{**words, "force": True})
    odd = Straightener(straightener.camera, ViewOptions(size=(81, 55)))
    straighten_one_video(odd, ["in.mp4"], "out.mp4", **{**words, "force": True, "as_json": True})
    captured = capsys.readouterr()
    assert '"pixel_format": "yuv444p"' in captured.out
    assert captured.err == "the pixel format is yuv444p: libx264 does not support yuv420p here\n"
