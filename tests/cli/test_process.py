"""The command line as a process: what is loaded, streams that end early, Ctrl-C."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pinholify.cli import COMMANDS

HEAVY = ("numpy", "cv2", "scipy", "matplotlib", "rich", "PIL", "reportlab")
PINHOLIFY = (sys.executable, "-m", "pinholify")


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout


def test_importing_the_command_line_or_the_package_loads_nothing_heavy():
    code = f"import sys, pinholify, pinholify.cli; print([m for m in {HEAVY} if m in sys.modules])"
    assert python(code).strip() == "[]"


def test_no_help_loads_anything_heavy():
    code = f"""
import contextlib, io, sys
from pinholify.cli import COMMANDS, main
with contextlib.redirect_stdout(io.StringIO()):
    assert [main([name, "--help"]) for name in COMMANDS] == [0] * len(COMMANDS)
print([m for m in {HEAVY} if m in sys.modules])"""
    assert python(code).strip() == "[]"


@pytest.mark.parametrize("words", [["--help"], *([name, "-h"] for name in COMMANDS)], ids=["pinholify", *COMMANDS])
def test_every_help_shows_an_example_in_one_piece(run, words):
    result = run(*words)
    assert result.status == 0
    lines = result.out.splitlines()
    where = next(i for i, line in enumerate(lines) if line.strip() in ("Example:", "Examples:"))
    examples = [line.strip() for line in lines[where + 1 :] if line.strip()]
    assert examples
    assert all("pinholify " in line and len(line) <= 80 for line in examples)


def test_the_list_of_commands(run):
    out = run("--help").out
    assert all(f"  {name} " in out for name in COMMANDS)


def test_version(run):
    import pinholify

    assert run("--version").out == f"pinholify, version {pinholify.__version__}\n"


def test_reader_that_has_seen_enough(camera):
    Path("uv.csv").write_text("u,v\n" + "100,200\n" * 6_000)
    command = subprocess.Popen(
        [*PINHOLIFY, "map", str(camera), "uv.csv", "--to", "rays"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert command.stdout is not None
    assert command.stdout.readline() == "x,y,z,std_px\n"
    command.stdout.close()
    assert command.stderr is not None
    with command.stderr as errors:
        assert errors.read() == ""
    assert command.wait() == 0


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no /dev/full here")
def test_full_disk_behind_standard_output(camera):
    Path("uv.csv").write_text("u,v\n100,200\n")
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [*PINHOLIFY, "map", str(camera), "uv.csv", "--to", "rays"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        "pinholify: 'standard output' cannot be written: the disk is full; free some space or choose another place"
    ]


def test_terminal_without_unicode(camera, table):
    done = subprocess.run(
        [*PINHOLIFY, "evaluate", str(camera), "--corners", str(table), "--no-opencv"],
        env={**os.environ, "PYTHONIOENCODING": "ascii"}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0
    assert r"\xb1" in done.stdout


def test_interrupt_leaves_nothing(photographs):
    folder = Path("many")
    folder.mkdir()
    (folder / "0.png").write_bytes((photographs / "small-00.png").read_bytes())
    for i in range(1, 5000):  # far more than any machine does meanwhile
        (folder / f"{i}.png").hardlink_to(folder / "0.png")
    command = subprocess.Popen(
        [*PINHOLIFY, "detect", str(folder), "--board", "9x6", "--workers", "1", "-o", "c.vnl"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's job in the background ignores it
    )  # fmt: skip
    time.sleep(2)
    command.send_signal(signal.SIGINT)
    out, errors = command.communicate(timeout=30)
    assert (command.returncode, out, errors.strip()) == (130, "", "pinholify: interrupted")
    assert not Path("c.vnl").exists()


def test_memory_that_does_not_suffice(refused, camera, photographs, monkeypatch):
    def too_much(*_, **__):
        raise MemoryError

    monkeypatch.setattr("pinholify.batch.straightening.decode_image", too_much)
    assert "not enough memory" in refused("undistort", camera, photographs, "-o", "out")


def test_folder_that_may_not_be_read(refused, monkeypatch):
    Path("locked").mkdir()

    def locked(self):
        raise PermissionError(13, "Permission denied", str(self))

    monkeypatch.setattr(Path, "iterdir", locked)
    assert "'locked' cannot be used: Permission denied" in refused("detect", "locked", "--board", "9x6")
