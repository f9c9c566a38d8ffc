"""Who may talk to the app, what it takes, and that nothing stays of what it refuses."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image
from running_app import TOKEN, App, add, running


def alive(client: httpx.Client) -> bool:
    return client.get("/api/about").status_code == 200


def test_the_first_page_gives_the_cookie_only_to_whoever_has_the_token(app: App):
    with httpx.Client(base_url=app.url) as stranger:
        refused = stranger.get("/")
        assert refused.status_code == 403
        assert "token" in refused.json()["error"]
        assert "set-cookie" not in refused.headers
        assert stranger.get("/", params={"token": "wrong"}).status_code == 403
        given = stranger.get("/", params={"token": TOKEN})
        cookie = given.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie


def test_two_apps_in_one_browser_keep_their_tokens_apart(app: App, tmp_path: Path):
    with running(tmp_path, token="another token") as other, httpx.Client() as browser:
        assert browser.get(app.url, params={"token": TOKEN}).status_code == 200
        assert browser.get(other.url, params={"token": "another token"}).status_code == 200
        assert [browser.get(f"{each.url}/api/about").status_code for each in (app, other)] == [200, 200]


def test_a_refusal_is_a_page_for_people(app: App):
    refused = httpx.get(app.url, headers={"accept": "text/html"})
    assert refused.status_code == 403
    assert "open the address shown in the terminal" in refused.text


@pytest.mark.parametrize(
    "path",
    ["/api/about", "/api/sessions", "/static/js/main.js", "/static/../../app.py", "/api/board?board=9x6&square_mm=25"],
)
def test_nothing_is_told_without_the_token(app: App, path: str):
    assert httpx.get(app.url + path).status_code == 403
    assert httpx.get(app.url + path, params={"token": TOKEN}).status_code == 403  # the token opens the first page alone


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:1"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
    ],
)
def test_another_sites_request_is_refused_even_with_the_cookie(client: httpx.Client, app: App, headers: dict[str, str]):
    before = app.files()
    refused = client.post("/api/sessions", json={}, headers=headers)
    assert refused.status_code == 403
    assert "another site" in refused.json()["error"]
    assert app.files() == before
    assert alive(client)


def test_a_form_of_another_site_cannot_send_the_header_that_changes_need(client: httpx.Client):
    del client.headers["x-pinholify"]
    assert client.post("/api/sessions", json={}).status_code == 403
    assert client.get("/api/sessions").status_code == 200


def test_the_pages_own_requests_pass(client: httpx.Client, app: App):
    headers = {"origin": app.url, "sec-fetch-site": "same-origin"}
    assert client.post("/api/sessions", json={}, headers=headers).status_code == 201


@pytest.mark.parametrize(
    ("host", "passes"),
    [("evil.example", False), ("127.0.0.1.evil.example", False), ("localhost:1", True), ("[::1]:1", True), ("", False)],
)
def test_a_name_that_others_can_point_here_is_refused(client: httpx.Client, host: str, passes: bool):
    assert client.get("/api/about", headers={"host": host}).status_code == (200 if passes else 421)


def test_pages_may_load_nothing_from_elsewhere(client: httpx.Client):
    headers = client.get("/").headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert "access-control-allow-origin" not in headers


@pytest.mark.parametrize(
    "name", ["../../../evil.png", "..\\..\\evil.png", "/etc/passwd", "a\0b\n<img src=x>.png", "...", "x" * 900]
)
def test_a_photographs_name_leads_nowhere(
    client: httpx.Client, session: str, app: App, photographs: list[Path], name: str
):
    added = add(client, session, photographs[0], name)
    assert added.status_code == 201
    told = added.json()["name"]
    assert not set("/\\\0\n<> ") & set(told)
    assert 0 < len(told) <= 130
    assert not list(app.folder.parent.rglob("*evil*"))
    assert {path.parts[0] for path in app.files()} <= {path.name for path in app.folder.iterdir()}


@pytest.mark.parametrize("address", ["..%2f..%2fetc", "%2e%2e", "0" * 16, "x"])
def test_a_sessions_address_leads_nowhere(client: httpx.Client, address: str):
    for path in ("", "/camera.npz", "/photographs/0000000000000000/view.jpg"):
        assert client.get(f"/api/sessions/{address}{path}").status_code == 404


def blank(width: int, height: int) -> bytes:
    """A PNG of so many pixels in few bytes."""
    file = io.BytesIO()
    Image.new("1", (width, height)).save(file, "PNG")
    return file.getvalue()


def zip_bomb() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("picture.png", bytes(50_000_000))
    return file.getvalue()


def cut_short(path: Path) -> bytes:
    data = path.read_bytes()
    return data[: len(data) // 2]


@pytest.mark.parametrize("kind", ["200 megapixels", "6 megapixels", "zip", "text", "empty", "cut"])
def test_what_is_no_photograph_is_refused_in_a_sentence_and_leaves_nothing(
    client: httpx.Client, session: str, app: App, photographs: list[Path], kind: str
):
    data = {
        "200 megapixels": lambda: blank(20_000, 10_000),
        "6 megapixels": lambda: blank(3000, 2000),
        "zip": zip_bomb,
        "text": lambda: b"not a picture",
        "empty": lambda: b"",
        "cut": lambda: cut_short(photographs[0]),
    }[kind]()
    before = app.files()
    refused = client.post(f"/api/sessions/{session}/photographs", params={"name": "holiday.png"}, content=data)
    assert refused.status_code == 422
    sentence = refused.json()["error"]
    assert "holiday.png" in sentence
    assert str(app.folder) not in sentence
    assert "megapixels" not in kind or "at most 4 megapixels" in sentence
    assert app.files() == before
    assert alive(client)


def test_an_upload_that_is_too_large_is_refused_whether_or_not_it_says_so(client: httpx.Client, session: str, app: App):
    before = app.files()

    def chunks():
        for _ in range(30):
            yield bytes(1_000_000)

    for content in (bytes(30_000_000), chunks()):
        try:
            refused = client.post(f"/api/sessions/{session}/photographs", params={"name": "a.png"}, content=content)
            assert refused.status_code == 413
            assert "20 MB" in refused.json()["error"]
        except httpx.TransportError:
            pass  # the app has hung up while the rest was still being sent
        assert alive(client)
    assert app.files() == before


def test_other_requests_are_small(client: httpx.Client):
    refused = client.post("/api/sessions", json={"board": "9" * 100_000})
    assert refused.status_code in {400, 413}
    assert alive(client)


def test_a_session_takes_so_many_photographs(client: httpx.Client, session: str):
    picture = io.BytesIO()
    Image.fromarray(np.zeros((30, 30), np.uint8)).save(picture, "PNG")
    address, data = f"/api/sessions/{session}/photographs", picture.getvalue()
    statuses = [client.post(address, params={"name": "a.png"}, content=data).status_code for _ in range(41)]
    assert statuses == [201] * 40 + [413]
