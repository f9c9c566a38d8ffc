"""The page in a real browser, with the network off: whole, quiet, and usable by mouse, finger and keyboard."""

import shutil

import numpy as np
import pytest

from pinholify.report.formats import write_report
from pinholify.report.html.scene import FILL, reach, turned

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
PHONE = {"width": 390, "height": 844}

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is found: apt-get install chromium")


@pytest.fixture(scope="module")
def address(report, tmp_path_factory):
    """The page as a file."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(path, report)
    return path.as_uri()


@pytest.fixture(scope="module")
def browser():
    """One Chromium for all tests of this module."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright drives the browser")
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--headless"])
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser, address):
    """Opens the page without a network; fails at the end on any error or any request it made."""
    contexts, wrong = [], []

    def opener(**options):
        contexts.append(browser.new_context(**{"offline": True, "viewport": {"width": 1200, "height": 900}, **options}))
        page = contexts[-1].new_page()
        page.on("console", lambda message: wrong.append(message.text))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        page.on("request", lambda request: wrong.append(request.url) if request.url.startswith("http") else None)
        page.goto(address)
        return page

    yield opener
    for context in contexts:
        context.close()
    assert wrong == []


def until(page, condition):
    """Wait for a condition; the page's own policy forbids the browser to evaluate text later, as its own wait does."""
    for _ in range(200):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"never came true: {condition}")


def test_all_pictures_are_there_and_no_name_ran(opened, hostile):
    page = opened()
    until(page, "[...document.images].every(image => image.complete)")
    assert page.evaluate("[...document.images].every(image => image.naturalWidth > 0)")
    assert page.locator("img").count() == 10 + 2 * 2
    assert page.title() == "Calibration of it's <b>.npz"
    assert page.get_by_text(hostile).first.is_visible()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_follow_the_system_and_can_be_read(opened, scheme):
    page = opened(color_scheme=scheme)
    ink, paper = (
        page.evaluate(f"getComputedStyle(document.body).{what}") for what in ("color", "backgroundColor")
    )
    light, dark = sorted((luminance(ink), luminance(paper)), reverse=True)
    assert (light + 0.05) / (dark + 0.05) > 12
    assert (luminance(paper) > 0.5) == (scheme == "light")
    for selector in (".caption", "nav a", ".level", ".badge.out"):
        colour = page.evaluate(f"getComputedStyle(document.querySelector('{selector}')).color")
        if selector != ".level":
            bright, dim = sorted((luminance(colour), luminance(paper)), reverse=True)
            assert (bright + 0.05) / (dim + 0.05) > 4.5, selector


def luminance(colour):
    """Relative luminance of ``rgb(r, g, b)`` (WCAG 2)."""
    channels = [int(part) / 255 for part in colour.strip("rgba() ").split(",")[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def test_the_slider_moves_by_keyboard_and_by_pointer(opened):
    page = opened()
    slider = page.locator("input[type=range]").first
    compare = page.locator(".compare").first
    slider.focus()
    page.keyboard.press("ArrowRight")
    assert compare.evaluate("element => element.style.getPropertyValue('--at')") == "51%"
    page.keyboard.press("End")
    assert compare.evaluate("element => element.style.getPropertyValue('--at')") == "100%"
    box = compare.locator(".halves").bounding_box()
    page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 20)
    page.mouse.up()
    assert abs(float(slider.input_value()) - 25) <= 1


def picture_of(page):
    return page.evaluate("document.querySelector('canvas').toDataURL()")


def test_the_scene_turns_by_mouse_keyboard_and_buttons(opened):
    page = opened()
    canvas = page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    until(page, "document.querySelector('canvas').width > 300")
    home = picture_of(page)
    assert not page.locator(".still").is_visible()
    box = canvas.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] + 60, middle[1] + 30)
    page.mouse.up()
    turned = picture_of(page)
    assert turned != home
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    assert picture_of(page) != turned
    page.keyboard.press("0")
    page.mouse.move(2, 2)
    assert picture_of(page) == home
    for name in ("Turn left", "Tilt up", "Zoom in"):
        before = picture_of(page)
        page.get_by_role("button", name=name).click()
        assert picture_of(page) != before, name
    lines = page.get_by_role("button", name="Lines of sight")
    before = picture_of(page)
    lines.click()
    assert lines.get_attribute("aria-pressed") == "false"
    assert picture_of(page) != before


def test_the_canvas_begins_as_the_still_drawing(opened, report):
    page = opened()
    until(page, "document.querySelector('canvas').width > 300")
    box = page.locator("canvas").bounding_box()
    # The camera's centre, a dot of its own colour, is where the still drawing has it.
    place = page.evaluate(
        """() => { const canvas = document.querySelector("canvas"), { width, height } = canvas;
          const data = canvas.getContext("2d").getImageData(0, 0, width, height).data; let n = 0, x = 0, y = 0;
          for (let i = 0; i < data.length; i += 4) if (data[i] === 163 && data[i + 1] === 61 && data[i + 3] === 255)
            { n += 1; x += (i / 4) % width; y += Math.floor(i / 4 / width); }
          return [x / n, y / n]; }"""
    )
    points = np.concatenate([report.scene.boards.reshape(-1, 3), report.scene.frustum, np.zeros((1, 3))])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    size = np.array([box["width"], box["height"]])
    scale = FILL * (size / reach(report.scene)).min()
    assert place == pytest.approx(size / 2 + scale * turned(-middle[None])[0][0], abs=2)


def test_a_board_under_the_pointer_is_named(opened, report):
    page = opened()
    canvas = page.locator("canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    seen = set()
    for across in range(5, 100, 5):
        page.mouse.move(box["x"] + box["width"] * across / 100, box["y"] + box["height"] / 2)
        seen.add(page.locator(".pointed").inner_text())
    assert seen & set(report.scene.names)
    assert seen <= {*report.scene.names, ""}


def test_lines_are_copied(opened):
    page = opened(permissions=["clipboard-read", "clipboard-write"])
    page.get_by_role("button", name="Copy: Straighten photographs").click()
    until(page, "document.querySelector('.snippet button').textContent === 'Copied'")
    assert page.evaluate("navigator.clipboard.readText()") == page.locator("code").first.text_content()


def test_without_scripts_everything_is_still_there(opened):
    page = opened(java_script_enabled=False)
    assert page.locator(".still").is_visible()
    assert not page.locator("canvas").is_visible()
    halves = page.locator(".half").all()
    assert len(halves) == 4
    assert all(half.is_visible() for half in halves)
    assert not page.locator("input").first.is_visible()
    assert not page.locator(".controls").is_visible()


def test_a_phone_needs_no_sideways_scrolling_and_a_finger_moves_things(opened):
    page = opened(viewport=PHONE, has_touch=True, is_mobile=True)
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    halves = page.locator(".halves").first
    halves.scroll_into_view_if_needed()
    box = halves.bounding_box()
    page.touchscreen.tap(box["x"] + 0.8 * box["width"], box["y"] + 30)
    assert abs(float(page.locator("input[type=range]").first.input_value()) - 80) <= 1
    for button in page.locator("button").all():
        size = button.bounding_box()
        assert min(size["width"], size["height"]) >= 24


def test_print_shows_what_a_screen_would_let_one_turn(opened):
    page = opened()
    page.emulate_media(media="print")
    assert page.locator(".still").is_visible()
    assert not page.locator("canvas").is_visible()
    assert not page.locator("nav").is_visible()
    first, second = (half.bounding_box() for half in page.locator(".half").all()[:2])
    assert second["x"] >= first["x"] + first["width"]
    assert len(page.pdf(format="A4")) > 10_000


def test_every_control_is_reached_by_the_tab_key(opened):
    page = opened()
    wanted = page.locator("button, input, canvas").count()
    reached = set()
    for _ in range(90):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("[...document.querySelectorAll('button,input,canvas')].indexOf(document.activeElement)"))
    assert len(reached - {-1}) == wanted


def test_controls_have_names_for_a_screen_reader(opened):
    page = opened()
    tree = page.locator("body").aria_snapshot()
    for said in ('heading "Calibration of', 'navigation "Sections of this report"', 'slider "a0.png', "banner", "main"):
        assert said in tree, said
    assert 'button:' not in tree.replace('button "', "")
