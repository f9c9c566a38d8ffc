"""A small camera, photographs of its board, and the command line in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pinholify.cli import main
from pinholify.geometry import Pose
from pinholify.io.corner_tables import write_corner_table
from pinholify.io.images import write_image
from pinholify.simulation.views import board_poses
from small_camera import BOARD, FROM_TABLE, LENS, SMALL, corner_set


@dataclass(frozen=True)
class Run:
    """What one run of the command line left."""

    status: int
    out: str
    err: str

    @property
    def sentence(self) -> str:
        """The one line on standard error of a refused run."""
        lines = self.err.splitlines()
        assert len(lines) == 1, self.err
        assert lines[0].startswith("pinholify: "), self.err
        return lines[0].removeprefix("pinholify: ")


Command = Callable[..., Run]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Command:
    """Runs ``pinholify`` with the given words in this process."""

    def command(*words: object) -> Run:
        capsys.readouterr()
        try:
            status = main([str(word) for word in words])
        except SystemExit as end:
            status = int(end.code or 0)
        captured = capsys.readouterr()
        return Run(status, captured.out, captured.err)

    return command


@pytest.fixture
def refused(run: Command) -> Callable[..., str]:
    """Runs a command that must be refused, with one sentence, and gives the sentence."""

    def command(*words: object) -> str:
        result = run(*words)
        assert result.status == 1, result
        assert "Traceback" not in result.err
        return result.sentence

    return command




@pytest.fixture(scope="session")
def poses() -> tuple[Pose, ...]:
    return board_poses((LENS,), BOARD, 9, seed=3)


@pytest.fixture(scope="session")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of seven photographs, the first board filling the frame."""
    folder = tmp_path_factory.mktemp("photographs")
    for picture in SMALL.photographs():
        write_image(folder / f"{picture.name}.png", picture.image)
    return folder


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory, poses: tuple[Pose, ...]) -> Path:
    """A corner table of nine boards."""
    path = tmp_path_factory.mktemp("table") / "corners.vnl"
    write_corner_table(path, corner_set(poses))
    return path




@pytest.fixture(scope="session")
def camera(tmp_path_factory: pytest.TempPathFactory, table: Path) -> Path:
    """The small camera's file, calibrated from the table."""
    path = tmp_path_factory.mktemp("camera") / "camera.npz"
    assert main(["calibrate", "--corners", str(table), *FROM_TABLE, "-o", str(path)]) == 0
    return path


@pytest.fixture(autouse=True)
def in_own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every test works in a folder of its own, in which no temporary file may be left, and in one process."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    yield
    left = [p for p in tmp_path.rglob(".*") if p.is_file()]
    assert not left
