"""From photographs to downloads through the app's addresses, and that nothing is lost."""

from __future__ import annotations

import json
import zipfile
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote

import cv2
import httpx
import pytest
from clip import true_focal_px
from running_app import App, add, new_session, opened, outdated, running, settled, until

from pinholify.io.camera_file import read_camera
from pinholify.io.export import FORMATS, format_named
from pinholify.io.images import decode_image, write_image


@pytest.fixture(scope="module")
def calibrated(app: App, photographs: list[Path]) -> str:
    """A session with a camera of all photographs."""
    with opened(app) as client:
        session = new_session(client, square_mm=25)
        for path in photographs:
            assert add(client, session, path).status_code == 201
        settled(client, session)
    return session


@pytest.mark.slow
def test_the_board_and_the_camera_are_found(client: httpx.Client, calibrated: str):
    state = settled(client, calibrated)
    result = state["result"]
    assert state["session"]["board"]["spec"] == "9x6"
    assert result["stage"] == "evaluated"
    assert result["f_px"] == pytest.approx(true_focal_px(), abs=5 * result["f_px_std"])
    assert result["f_px_std"] < 0.005 * result["f_px"]
    assert result["level"] in {"good", "fair"}
    assert result["sentence"].endswith(".")
    assert "photograph the board" not in result["sentence"]
    assert result["sentence"] == f"{result['level'].capitalize()}: {'; '.join(result['findings'])}."
    assert result["next"]["place"]
    assert set(result["boards"]) == {photograph["id"] for photograph in state["photographs"]}
    for photograph in state["photographs"]:
        assert len(result["boards"][photograph["id"]]["residuals"]) == len(photograph["uv"]) == 54


@pytest.mark.slow
def test_the_camera_file_is_the_result(client: httpx.Client, calibrated: str, tmp_path: Path):
    path = tmp_path / "camera.npz"
    path.write_bytes(client.get(f"/api/sessions/{calibrated}/camera.npz").content)
    calibration, result = read_camera(path), settled(client, calibrated)["result"]
    assert calibration.camera.intrinsics.f == pytest.approx(result["virtual"]["f"][0], abs=1e-5)
    assert calibration.square_mm == 25
    assert len(calibration.corner_set.found) == 12


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_every_export_can_be_downloaded(client: httpx.Client, calibrated: str, app: App, name: str):
    before = app.files()
    answer = client.get(f"/api/sessions/{calibrated}/export/{name}")
    assert answer.status_code == 200
    assert answer.headers["content-disposition"].startswith("attachment")
    assert len(answer.content) > 100
    if ".zip" in answer.headers["content-disposition"]:
        assert len(zipfile.ZipFile(BytesIO(answer.content)).namelist()) > 1
    until(client, calibrated, lambda _: app.files() == before)
    told = json.loads(unquote(answer.headers.get("x-notes", "[]")))
    lost = format_named(name).lost
    assert not lost or lost in told


@pytest.mark.slow
def test_the_report_can_be_downloaded(client: httpx.Client, calibrated: str):
    answer = client.get(f"/api/sessions/{calibrated}/report.html")
    assert answer.status_code == 200
    assert "attachment" in answer.headers["content-disposition"]
    assert "<html" in answer.text
    assert settled(client, calibrated)["activity"] is None


@pytest.mark.slow
def test_an_opened_report_has_no_origin_and_loads_nothing(client: httpx.Client, calibrated: str):
    answer = client.get(f"/api/sessions/{calibrated}/report")
    assert answer.headers["content-type"].startswith("text/html")
    policy = answer.headers["content-security-policy"]
    assert "sandbox allow-scripts;" in policy
    assert "default-src 'none'" in policy
    assert "allow-same-origin" not in policy
    page = client.get("/api/sessions/0123456789abcdef/report", headers={"accept": "text/html"})
    assert page.status_code == 404
    assert "there is no such session" in page.text
    assert page.headers["content-type"].startswith("text/html")


@pytest.mark.slow
def test_an_unknown_export_is_a_sentence(client: httpx.Client, calibrated: str):
    refused = client.get(f"/api/sessions/{calibrated}/export/..%2f..")
    assert refused.status_code == 404
    assert "unknown export format" in client.get(f"/api/sessions/{calibrated}/export/nothing").json()["error"]


@pytest.mark.slow
def test_a_photograph_is_straightened(client: httpx.Client, calibrated: str):
    photograph = settled(client, calibrated)["photographs"][3]["id"]
    address = f"/api/sessions/{calibrated}/photographs/{photograph}"
    data = [client.get(f"{address}/{name}").content for name in ("view.jpg", "thumb.jpg", "straight.jpg")]
    assert [decode_image(each, "picture").shape for each in data] == [(480, 640), (360, 480), (480, 640)]


def test_a_board_can_be_printed(client: httpx.Client, session: str, app: App):
    before = app.files()
    answer = client.get("/api/board", params={"board": "9x6", "square_mm": 25, "page": "A4"})
    assert answer.content.startswith(b"%PDF")
    refused = client.get("/api/board", params={"board": "9x6", "square_mm": 250})
    assert "does not fit" in refused.json()["error"]
    assert client.get("/api/board", params={"board": "9x6", "square_mm": 25, "ending": "/../x"}).status_code == 422
    until(client, session, lambda _: app.files() == before)


@pytest.mark.slow
def test_leaving_a_photograph_out_changes_the_result(client: httpx.Client, calibrated: str):
    before = settled(client, calibrated)
    first = before["photographs"][5]["id"]
    address = f"/api/sessions/{calibrated}/photographs/{first}"
    assert client.patch(address, json={"included": False}).status_code == 200
    without = until(client, calibrated, lambda s: s["activity"] is None and s["final"] and not outdated(s))
    assert first not in without["result"]["photographs"]
    assert without["result"]["virtual"] != before["result"]["virtual"]
    client.patch(address, json={"included": True})
    again = until(client, calibrated, lambda s: s["activity"] is None and s["final"] and not outdated(s))
    assert again["result"]["f_px"] == pytest.approx(before["result"]["f_px"], abs=1e-3)


@pytest.mark.slow
def test_a_restart_loses_nothing(tmp_path: Path, photographs: list[Path]):
    with running(tmp_path) as app, opened(app) as client:
        session = new_session(client)
        for path in photographs[:6]:
            add(client, session, path)
        before = settled(client, session)
    (tmp_path / session / "arriving-0123").write_bytes(b"half of a picture")
    (tmp_path / ("0" * 16)).mkdir()
    (tmp_path / ("0" * 16) / "session.json").write_text("{")
    with running(tmp_path) as app, opened(app) as client:
        assert [s["id"] for s in client.get("/api/sessions").json()] == [session]
        after = client.get(f"/api/sessions/{session}").json()
        assert client.get(f"/api/sessions/{session}/camera.npz").status_code == 200
    assert after == before
    assert not (tmp_path / session / "arriving-0123").exists()


def test_sessions_stand_side_by_side(client: httpx.Client, photographs: list[Path], app: App):
    one, other = new_session(client), new_session(client, board="7x5")
    add(client, one, photographs[1])
    assert len(client.get(f"/api/sessions/{other}").json()["photographs"]) == 0
    wrong = add(client, other, photographs[1]).json()
    assert not wrong["found"]
    assert wrong["suggestion"] == "9x6"
    for session in (one, other):
        client.delete(f"/api/sessions/{session}")
        assert not (app.folder / session).exists()
        assert client.get(f"/api/sessions/{session}").status_code == 404


@pytest.mark.slow
def test_the_right_board_makes_good_for_a_wrong_one(client: httpx.Client, photographs: list[Path]):
    session = new_session(client, board="7x5")
    for path in photographs[1:6]:
        add(client, session, path)
    client.patch(f"/api/sessions/{session}", json={"board": "9x6"})
    state = until(client, session, lambda s: s["activity"] is None and s["result"] and s["final"])
    assert all(photograph["found"] for photograph in state["photographs"])
    client.delete(f"/api/sessions/{session}")


@pytest.mark.slow
def test_work_can_be_cancelled_and_what_was_there_stays(client: httpx.Client, photographs: list[Path], app: App):
    session = new_session(client)
    for path in photographs[:6]:
        add(client, session, path)
    before = settled(client, session)
    client.patch(f"/api/sessions/{session}/photographs/{before['photographs'][0]['id']}", json={"included": False})
    until(client, session, lambda s: not s["final"])  # a first look at the camera without it
    client.post(f"/api/sessions/{session}/cancel")
    after = until(client, session, lambda s: s["activity"] is None)
    assert after["result"] == before["result"]
    assert after["final"]
    assert len(list((app.folder / session).glob("solve-*"))) == 1
    client.delete(f"/api/sessions/{session}")


def test_boards_that_all_stand_alike_are_a_sentence(client: httpx.Client, photographs: list[Path]):
    session = new_session(client)
    for name in ("a.png", "b.png", "c.png"):
        add(client, session, photographs[1], name)
    state = settled(client, session)
    assert state["result"] is None
    assert len(state["problem"]) > 20
    client.delete(f"/api/sessions/{session}")


def test_changes_are_told_as_they_happen(client: httpx.Client, session: str, photographs: list[Path]):
    kinds = []
    with client.stream("GET", f"/api/sessions/{session}/events") as stream:
        assert stream.headers["content-type"].startswith("text/event-stream")
        lines = stream.iter_lines()
        for path in (None, *photographs[:4]):
            if path:
                add(client, session, path)
        for line in lines:
            if line.startswith("data: "):
                event = json.loads(line.removeprefix("data: "))
                kinds.append(event["kind"])
                if event["kind"] == "result" and event["result"]:
                    break
    assert kinds[0] == "snapshot"
    assert kinds.count("photograph") >= 4
    assert "activity" in kinds


def test_a_live_frame_is_kept_once_it_is_still_and_new(client: httpx.Client, session: str, photographs: list[Path]):
    frame = photographs[2].read_bytes()
    told = [client.post(f"/api/sessions/{session}/frames", content=frame).json() for _ in range(3)]
    assert [bool(answer["kept"]) for answer in told] == [False, True, False]
    assert "move or tilt" in told[2]["hint"]
    assert len(told[0]["uv"]) == 54
    assert len(client.get(f"/api/sessions/{session}").json()["photographs"]) == 1


@pytest.mark.slow
def test_frames_of_a_video_are_chosen(client: httpx.Client, session: str, photographs: list[Path], tmp_path: Path):
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 10.0, (640, 480))
    for source in photographs[:6]:
        for _ in range(10):
            writer.write(cv2.imread(str(source)))
    writer.release()
    client.post(f"/api/sessions/{session}/videos", params={"name": "clip.avi"}, content=path.read_bytes())
    state = settled(client, session)
    assert 4 <= len(state["photographs"]) <= 6  # two that stand almost alike are one
    assert state["problem"] is None  # as few frames would have, while the video is still looked through
    assert state["result"]["f_px"] == pytest.approx(true_focal_px(), rel=0.02)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"#EXTM3U\n#EXTINF:1,\nfile:///etc/passwd\n", "is not a video that this app reads"),
        (b"ffconcat version 1.0\nfile /etc/passwd\n", "is not a video that this app reads"),
        (b"RIFF....WAVE", "is not a video that this app reads"),
        (b"\x1aE\xdf\xa3 cut", "cannot be read as a video"),
    ],
)
def test_what_is_no_video_is_refused_in_a_sentence(
    client: httpx.Client, session: str, app: App, data: bytes, why: str
):
    before = app.files()
    with client.stream("GET", f"/api/sessions/{session}/events") as stream:
        client.post(f"/api/sessions/{session}/videos", params={"name": "film.mp4"}, content=data)
        events = (json.loads(line.removeprefix("data: ")) for line in stream.iter_lines() if line.startswith("data: "))
        notice = next(event for event in events if event["kind"] == "notice")
    assert f"'film.mp4' {why}" in notice["text"]
    until(client, session, lambda s: s["activity"] is None)
    assert app.files() == before


def test_photographs_of_another_size_do_not_count(
    client: httpx.Client, session: str, photographs: list[Path], tmp_path: Path
):
    small = tmp_path / "small.png"
    write_image(small, cv2.resize(cv2.imread(str(photographs[1])), (480, 360), interpolation=cv2.INTER_AREA))
    add(client, session, photographs[1])
    add(client, session, photographs[2])
    odd = add(client, session, small).json()
    state = client.get(f"/api/sessions/{session}").json()
    assert odd["found"]
    assert odd["id"] not in state["session"]["usable"]
