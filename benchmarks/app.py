"""From dropping photographs on the app's page to the first overlay, the first straight picture and the verdict.

    python benchmarks/app.py photographs/

Drives Chromium, as tests/web/test_browser.py does. The time to find the board and to calibrate on the command line, in
the same run, stands beside, so that the page's own share can be told on any machine.
"""

import shutil
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "web"), str(ROOT / "tests")]

from playwright.sync_api import sync_playwright
from running_app import PATIENCE, running

from pinholify.detection import detect_files
from pinholify.io.images import image_paths
from pinholify.pipeline import calibrate
from pinholify.web.inspection import inspect_file
from pinholify.web.limits import Limits

CHOOSING = 6.0  # seconds that a person takes to choose photographs, while the app's processes start
MOMENTS = {
    "first overlay": ".tile .overlay",
    "first straight picture": ".frame.ready",
    "all photographs": "body:not(:has(.arriving))",
    "verdict": ":is(.verdict.good, .verdict.fair, .verdict.poor)",
}


def moments(files: list[Path]) -> dict[str, float]:
    """Seconds from the drop to each of ``MOMENTS``, in a fresh app and browser."""
    with tempfile.TemporaryDirectory() as folder, running(Path(folder), Limits()) as app, sync_playwright() as driver:
        chromium = shutil.which("chromium") or shutil.which("google-chrome")
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        page.goto(app.address)
        page.wait_for_selector("#drop")
        page.wait_for_timeout(1000 * CHOOSING)
        start, seconds = time.perf_counter(), {}
        page.set_input_files("#files", files)
        for name, selector in MOMENTS.items():
            page.wait_for_selector(selector, timeout=10_000 * PATIENCE)
            seconds[name] = time.perf_counter() - start
        browser.close()
    return seconds


def main() -> None:
    """Print both."""
    files = image_paths(sys.argv[1:])
    board = next(filter(None, (inspect_file(path, path.name, None, False, 10**9, None).board for path in files)))
    start = time.perf_counter()
    corners = detect_files(files, board)
    found = time.perf_counter()
    calibrate(corners)
    done = time.perf_counter()
    print(f"{len(files)} photographs of {board.spec}, one process: found in {found - start:.1f} s, "
          f"calibrated in {done - found:.1f} s")
    for name, seconds in moments(files).items():
        print(f"{name:24s}{seconds:8.1f} s {seconds / (done - start):6.2f} times finding and calibrating")


if __name__ == "__main__":
    main()
