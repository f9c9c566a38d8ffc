"""The app in a real browser: from the first screen to a download, the live camera, drops, and sentences for errors."""

from __future__ import annotations

import base64
import io
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
from clip import true_focal_px, write_clip
from PIL import Image
from running_app import App

from pinholify.io.camera_file import read_camera
from small_camera import BOARD

api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: pip install 'pinholify[test]'")

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
PATIENCE_MS = 90_000
FAKE_CAMERA = ("--use-fake-device-for-media-stream", "--use-fake-ui-for-media-stream")
GOPRO = Path(__file__).parents[3] / "shared" / "data" / "gopro_wide"

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium was found; install the package chromium")

Open = Callable[..., Any]


@pytest.fixture
def open_page(app: App) -> Iterator[Open]:
    """Opens the app's first screen in a new browser; at the end no console may have an error or a warning."""
    complaints: list[str] = []
    with ExitStack() as stack:

        def opening(*arguments: str, **options: Any) -> Any:
            page = stack.enter_context(browser_page(arguments, options))
            page.on("console", lambda said: complaints.append(said.text) if said.type in {"error", "warning"} else None)
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.goto(app.address)
            return page

        yield opening
    assert not complaints


@contextmanager
def browser_page(arguments: tuple[str, ...], options: dict[str, Any]) -> Iterator[Any]:
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", *arguments])
        page = browser.new_page(**options)
        page.set_default_timeout(PATIENCE_MS)
        yield page
        browser.close()


def download(page: Any, selector: str, folder: Path) -> Path:
    """The file that a click on ``selector`` brings."""
    with page.expect_download() as waiting:
        page.click(selector)
    path = folder / waiting.value.suggested_filename
    waiting.value.save_as(path)
    return path


def judged(page: Any) -> None:
    """Waits for the verdict on a camera that nobody works on any more."""
    page.wait_for_selector(":is(.verdict.good, .verdict.fair, .verdict.poor) .chip")
    page.wait_for_selector("#activity", state="hidden")


def count(page: Any, selector: str, number: int) -> None:
    """Waits until there are ``number`` of ``selector``."""
    api.expect(page.locator(selector)).to_have_count(number, timeout=2 * PATIENCE_MS)


def focal(page: Any) -> float:
    return float(re.match(r"[\d.]+", page.text_content("#focal"))[0])


def drop(page: Any, files: list[tuple[str, str, bytes]]) -> None:
    """Drops files (name, type, content) on the page."""
    data = [[name, kind, base64.b64encode(content).decode()] for name, kind, content in files]
    transfer = page.evaluate_handle(
        """files => {
            const transfer = new DataTransfer();
            for (const [name, type, text] of files) {
                const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
                transfer.items.add(new File([bytes], name, { type }));
            }
            return transfer;
        }""",
        data,
    )
    for event in ("dragenter", "dragover", "drop"):
        page.dispatch_event("#drop", event, {"dataTransfer": transfer})


def test_from_photographs_to_a_camera(open_page: Open, photographs: list[Path], tmp_path: Path):
    page = open_page()
    assert page.title() == "pinholify"
    assert "token" not in page.url
    page.set_input_files("#files", photographs)
    page.wait_for_selector(".tile .overlay")
    page.wait_for_selector(".frame.ready .after img")
    judged(page)
    assert page.locator(".tile").count() == len(photographs)
    assert focal(page) == pytest.approx(true_focal_px(), rel=0.005)
    calibration = read_camera(download(page, "#download-camera", tmp_path))
    assert calibration.corner_set.board == BOARD
    assert "<html" in download(page, "#download-report", tmp_path).read_text(encoding="utf-8")
    page.select_option("#format", "ros")
    assert "camera_matrix" in download(page, "#download-export", tmp_path).read_text()
    page.wait_for_selector(".notice:has-text('pinholify undistort')")
    with page.expect_popup() as waiting:
        page.click("#open-report")
    report = waiting.value
    report.wait_for_selector("main#report")
    assert report.evaluate("origin") == "null"
    assert report.locator(".snippet button").count()


@pytest.mark.slow
def test_a_reload_loses_nothing_and_a_photograph_can_be_left_out(open_page: Open, photographs: list[Path]):
    page = open_page()
    page.set_input_files("#files", photographs[:8])
    judged(page)
    shown = page.text_content("#focal")
    page.reload()
    judged(page)
    assert page.text_content("#focal") == shown
    assert page.locator(".tile").count() == 8
    page.locator(".tile input[type=checkbox]").nth(2).focus()
    page.keyboard.press("Space")
    count(page, ".tile.out", 1)
    count(page, ".columns .column", 7)
    judged(page)
    page.click("#all-sessions")
    page.wait_for_selector(".session")
    assert page.is_visible("#drop")


@pytest.mark.slow
def test_the_live_camera_calibrates_without_another_click(open_page: Open, tmp_path: Path):
    clip = tmp_path / "clip.y4m"
    write_clip(clip, 20)
    page = open_page(*FAKE_CAMERA, f"--use-file-for-fake-video-capture={clip}")
    page.click("#use-camera")
    page.wait_for_selector("#live:not([hidden])")
    page.wait_for_selector("#live-overlay .lattice")
    page.wait_for_selector("#live", state="hidden", timeout=3 * PATIENCE_MS)
    assert "The camera is calibrated" in page.text_content("#notices")
    judged(page)
    assert page.text_content(".verdict .chip") == "Good"
    assert focal(page) == pytest.approx(true_focal_px(), rel=0.01)


def test_photographs_can_be_dropped(open_page: Open, photographs: list[Path]):
    page = open_page()
    drop(page, [(path.name, "image/png", path.read_bytes()) for path in photographs[1:4]])
    count(page, ".tile .overlay", 3)
    assert "9×6" in page.text_content("#board-pill")


def test_files_chosen_before_the_page_is_ready_are_taken(open_page: Open, photographs: list[Path]):
    page = open_page()
    page.add_init_script(
        """const real = fetch;
        window.fetch = async (...asked) => {
            if (asked[0].endsWith("/about")) await new Promise((done) => setTimeout(done, 1000));
            return real(...asked);
        };"""
    )
    page.reload()
    page.set_input_files("#files", photographs[1:2])
    count(page, ".tile .overlay", 1)


def test_errors_are_sentences_on_the_page(open_page: Open, photographs: list[Path]):
    bomb = io.BytesIO()
    Image.new("1", (20_000, 10_000)).save(bomb, "PNG")
    page = open_page()
    drop(page, [("notes.png", "image/png", b"not a picture")])
    page.wait_for_selector(".notice:has-text('notes.png')")
    drop(page, [("huge.png", "image/png", bomb.getvalue())])
    page.wait_for_selector(".notice:has-text('megapixels')")
    for notice in page.locator(".notice p").all_text_contents():
        assert notice[0] in "'“" or notice[0].isupper()
        assert notice.endswith(".")
    assert page.locator(".tile").count() == 0


@pytest.mark.slow
def test_a_wrong_board_is_said_and_mended(open_page: Open, photographs: list[Path]):
    page = open_page()
    page.fill("#board", "7x5")
    page.set_input_files("#files", photographs[1:7])
    page.wait_for_selector(".verdict:has-text('These photographs show a board of 9×6 inner corners, not 7×5.')")
    page.click("text=Use 9×6")
    count(page, ".tile .overlay", 6)
    judged(page)


def test_a_board_that_cannot_be_read_is_said_before_anything_is_sent(open_page: Open, photographs: list[Path]):
    page = open_page()
    page.fill("#board", "nine by six")
    page.set_input_files("#files", photographs[:1])
    page.wait_for_selector(".notice:has-text('is not a board')")
    assert page.is_visible("#drop")


def test_a_board_can_be_printed(open_page: Open, tmp_path: Path):
    page = open_page()
    page.click("#print-first")
    page.fill("#print-square", "250")
    page.click("#print-download")
    page.wait_for_selector("#print-problem:has-text('does not fit')")
    page.fill("#print-square", "25")
    assert download(page, "#print-download", tmp_path).read_bytes().startswith(b"%PDF")


def test_photographs_without_a_board_are_said_and_mended(open_page: Open, tmp_path: Path):
    page = open_page()
    grey = io.BytesIO()
    Image.new("L", (320, 240), 128).save(grey, "PNG")
    drop(page, [("grey.png", "image/png", grey.getvalue())])
    page.wait_for_selector(".verdict:has-text('The photograph does not show a whole checkerboard.')")
    page.click("text=Select the board")
    page.fill("#new-board", "circles:7x5")
    page.click("#board-save")
    page.wait_for_selector(".verdict:has-text('The photograph does not show the board circles:7×5.')")


@pytest.mark.slow
def test_the_page_works_on_a_phone_by_keyboard_and_by_name(open_page: Open, photographs: list[Path]):
    page = open_page(viewport={"width": 390, "height": 844}, color_scheme="dark")
    page.set_input_files("#files", photographs[:6])
    judged(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select, a[href], meter, img")]
            .filter(e => e.getClientRects().length && !(e.labels?.length || e.ariaLabel || e.textContent.trim()
                || e.hasAttribute("alt") || e.getAttribute("aria-labelledby")))
            .map(e => e.outerHTML)"""
    )
    assert not unnamed
    page.focus(".split")
    page.keyboard.press("ArrowRight")
    assert page.input_value(".split") == "51"


@pytest.mark.slow
@pytest.mark.skipif(not GOPRO.is_dir(), reason="the real photographs are not here: ../shared/data/gopro_wide")
def test_real_photographs_of_a_wide_lens(open_page: Open, tmp_path: Path):
    page = open_page()
    page.set_input_files("#files", sorted(GOPRO.glob("*.jpg")))
    count(page, ".tile:not(.arriving)", 37)
    judged(page)
    page.wait_for_selector(".frame.ready")
    assert "8×6" in page.text_content("#board-pill")
    assert page.locator(".tile.out").count() == 1  # the street
    calibration = read_camera(download(page, "#download-camera", tmp_path))
    assert len(calibration.corner_set.found) == 36
