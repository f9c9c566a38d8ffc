"""The report of real photographs: all of them in it, and small enough to attach."""

from pathlib import Path

import pytest

from pinholify.cli import main

PHOTOGRAPHS = Path(__file__).parents[3] / "shared" / "data" / "gopro_wide"

pytestmark = pytest.mark.slow


def test_37_photographs_make_less_than_5_megabytes(tmp_path, monkeypatch):
    if not PHOTOGRAPHS.is_dir():
        pytest.skip("the real photographs are not beside the project (../shared/data)")
    monkeypatch.chdir(tmp_path)
    words = ("calibrate", str(PHOTOGRAPHS), "--board", "8x6", "--no-heldout", "--report", "report.html")
    assert main(list(words)) == 0
    page = (tmp_path / "report.html").read_bytes()
    assert len(page) < 5_000_000
    assert page.count(b"data:image/jpeg") == 37 + 2
    assert page.count(b"data:image/webp") == 2
