"""``pinholify serve`` as a process: its address, its folder, its end."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from pathlib import Path

import httpx
import pytest

from pinholify.cli import main


def test_it_serves_until_interrupted(tmp_path: Path):
    command = [sys.executable, "-m", "pinholify", "serve", "--no-open", "--folder", str(tmp_path / "sessions")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path) as process:
        address = process.stdout.readline().split()[-1]
        assert address.startswith("http://127.0.0.1:")
        assert len(address.partition("token=")[2]) >= 32
        with httpx.Client(timeout=60) as client:
            assert client.get(address.partition("?")[0]).status_code == 403
            assert "Drop ten or more photographs" in client.get(address).text
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert (process.returncode, out, err) == (0, "", "")
    assert [path.name for path in tmp_path.iterdir()] == ["sessions"]


def test_a_port_that_is_taken_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["serve", "--no-open", "--port", str(port), "--folder", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert f"port {port}" in error
    assert "choose another --port" in error


def test_the_app_without_its_packages_says_how_to_get_them(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "pinholify.web.server", raising=False)
    assert main(["serve", "--no-open"]) == 1
    assert "pip install 'pinholify[app]'" in capsys.readouterr().err
