"""``pinholify undistort`` of a video."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from videos import decoded, make_video

av = pytest.importorskip("av", reason="needs the extra 'video'")

MOMENTS = list(range(0, 24 * 1001, 1001))


@pytest.fixture
def clip():
    make_video(Path("in.mp4"), (640, 480), MOMENTS, sound=True)
    return "in.mp4"


def test_a_video_is_straightened_from_file_to_file(run, camera, clip):
    result = run("undistort", camera, clip, "-o", "out.mp4")
    assert (result.status, result.out, result.err) == (0, "wrote out.mp4: 24 frames\n", "")
    again = run("undistort", camera, clip, "-o", "out.mp4")
    assert (again.status, "is already there" in again.err) == (1, True)
    result = run("undistort", camera, clip, "-o", "out.mp4", "--size", "321x241", "--force", "--json")
    data = json.loads(result.out)
    assert data["written"] == ["out.mp4"]
    assert (data["frames"], data["encoder"], data["pixel_format"]) == (24, "libx264", "yuv444p")
    assert result.err == "the pixel format is yuv444p: libx264 does not support yuv420p here\n"
    assert (decoded("out.mp4")[0].width, decoded("out.mp4")[0].height) == (321, 241)


@pytest.fixture
def half_a_clip(clip):
    """The first half of a file that says what is in it before it comes."""
    with av.open(clip) as original, av.open("whole.mp4", "w", container_options={"movflags": "+faststart"}) as copy:
        streams = {s.index: copy.add_stream_from_template(s) for s in original.streams}
        for packet in original.demux():
            if packet.size:
                packet.stream = streams[packet.stream_index]
                copy.mux(packet)
    data = Path("whole.mp4").read_bytes()
    Path("half.mp4").write_bytes(data[: len(data) // 2])
    return "half.mp4"


def test_half_a_video_is_straightened_and_told(run, camera, half_a_clip):
    result = run("undistort", camera, half_a_clip, "-o", "out.mp4")
    count = len(decoded("out.mp4"))
    assert 4 < count < 20
    told = f"'half.mp4' ends early: {count} of about 24 frames are there; it was cut short or is damaged: copy it again"
    assert (result.status, result.out) == (1, f"wrote out.mp4: {count} frames\n")
    assert result.err == f"pinholify: {told}\n"
    result = run("undistort", camera, half_a_clip, "-o", "again.mp4", "--json")
    assert result.status == 1
    assert json.loads(result.out)["failed"] == {"half.mp4": told}


def test_ctrl_c_leaves_whole_parts_and_no_video(run, camera, clip, monkeypatch):
    from pinholify.batch import video
    from pinholify.io.video import segments

    monkeypatch.setattr(video, "SEGMENT", 10)
    add, added = segments.SegmentFolder.add, []

    def interrupted(self, segment):
        add(self, segment)
        added.append(segment)
        if len(added) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr(segments.SegmentFolder, "add", interrupted)
    result = run("undistort", camera, clip, "-o", "out.mp4")
    assert result.status == 130
    start = "stopped; run the same command to continue: what is done so far is kept in out.mp4.parts-"
    assert result.err.startswith(start)
    (parts,) = Path().glob("out.mp4.*")
    assert sorted(p.name for p in parts.iterdir()) == ["000000.npz", "000001.npz"]
    assert run("undistort", camera, clip, "-o", "out.mp4").out == "wrote out.mp4: 24 frames\n"
    assert len(added) == 3
    assert len(decoded("out.mp4")) == 24
    assert not parts.exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["in.mp4", "-o", "out.mp4", "--workers", "2"], "--workers and --scheduler are for images"),
        (["in.mp4", "-o", "out.mp4", "--scheduler", "tcp://127.0.0.1:9"], "--workers and --scheduler are for images"),
        (["in.png", "-o", "out", "--quality", "20"], "--codec and --quality are for videos"),
        (["in.png", "-o", "out", "--workers", "2", "--scheduler", "a"], "give either --workers or --scheduler"),
    ],
)
def test_options_that_do_not_go_together(run, camera, words, sentence):
    result = run("undistort", camera, *words)
    assert result.status == 2
    assert sentence in result.err


def test_refusals(refused, camera, clip):
    assert "straighten each by itself" in refused("undistort", camera, clip, "b.mp4", "-o", "out.mp4")
    assert "on this machine only" in refused("undistort", camera, clip, "-o", "memory://out.mp4")
    assert "end its name in one of .mp4" in refused("undistort", camera, clip, "-o", "out")
    assert "is one of the inputs" in refused("undistort", camera, clip, "-o", clip, "--force")
