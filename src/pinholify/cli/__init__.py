"""The command line. Each command is a module, imported only when it is called, so that ``--help`` is fast."""

from __future__ import annotations

import importlib
import io
import os
import sys

import click

from pinholify import __version__
from pinholify.errors import PinholifyError
from pinholify.io.memory import keep_freed_memory
from pinholify.io.threads import one_blas_thread

INTERRUPTED = 130  # the status that shells report for a process ended by Ctrl-C

COMMANDS = {
    "detect": "Find the corners of a board in photographs.",
    "calibrate": "Calibrate a camera as a perfect pinhole camera, from photographs of a board.",
    "map": "Map points between pixels, the virtual plane and rays.",
    "undistort": "Straighten photographs.",
    "export": "Write an ideal pinhole view as another program's calibration file.",
    "import": "Convert another program's calibration file to a camera file.",
    "mode": "Convert a camera to another mode of its sensor: cropped, binned or scaled.",
    "evaluate": "Score a camera on photographs of a board.",
    "report": "Write a self-contained report on how good a camera is.",
    "compare": "Measure how far two cameras differ, in px over the image.",
    "board": "Draw a board to print, true to scale.",
    "serve": "Calibrate in your browser, from photographs or a live camera.",
    "gray-code": "Make Gray codes for a screen, and decode photographs of them.",
    "simulate": "Render the paper's six data sets, with ground truth.",
    "reproduce": "Reproduce the paper's tables and figures, next to its own numbers.",
    "demo": "See it work: render a warped scene, calibrate the camera, straighten the scene.",
}


class LazyGroup(click.Group):
    """A click group that imports a command only when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of all commands, in the order in which they are typically used."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command ``cmd_name``; None if there is no such command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"pinholify.cli.{cmd_name.replace('-', '_')}_command")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="""\b
Example:
  pinholify calibrate photos/ --board 15x9 -o camera.npz
  pinholify undistort camera.npz photos/ -o straight/""",
)
@click.version_option(__version__, prog_name="pinholify")
def cli() -> None:
    """Turn any camera into a perfect pinhole camera: no lens model, straight lines straight, honest error bars."""


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return the exit status: 0 done, 1 refused, 2 wrong usage, 130 interrupted."""
    one_blas_thread()
    keep_freed_memory()
    _accept_any_character()
    try:
        status = cli.main(arguments, prog_name="pinholify", standalone_mode=False)
        sys.stdout.flush()
        return int(status or 0)
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except (click.Abort, KeyboardInterrupt):
        click.echo("pinholify: interrupted", err=True)
        return INTERRUPTED
    except (BrokenPipeError, SystemExit):  # the reader closed the pipe; click may notice first and exit
        _discard_output()
        return 0
    except PinholifyError as error:
        return _refuse(str(error))
    except MemoryError:
        return _refuse("not enough memory for images of this size; use smaller ones")
    except OSError as error:
        return _refuse(_sentence(error))


def _accept_any_character() -> None:
    """Escape characters that a stream's encoding lacks, so that no file name or sign can end a run with an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _refuse(sentence: str) -> int:
    click.echo(f"pinholify: {sentence}", err=True)
    return 1


def _sentence(error: OSError) -> str:
    """The sentence for an OSError that no reader or writer of files has handled: of a stream, or of a folder."""
    if error.filename is not None:
        return f"'{error.filename}' cannot be used: {error.strerror}; check the path and its permissions"
    from pinholify.io.files import cannot_write

    _discard_output()
    return str(cannot_write("standard output", error))


def _discard_output() -> None:
    """Point standard output at the null device, or Python's final flush would raise the same error again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
