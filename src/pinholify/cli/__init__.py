"""The command line. Each command is a module, loaded only when it is called, so that ``--help`` answers at once."""

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

INTERRUPTED = 130  # as shells count a process that Ctrl-C ended

COMMANDS = {
    "detect": "Find the corners of a board in photographs.",
    "calibrate": "Make a perfect pinhole camera from photographs of a board.",
    "map": "Map points between pixels, the virtual plane and rays.",
    "undistort": "Straighten photographs.",
    "export": "Write an ideal pinhole view as other programs' calibration files.",
    "import": "Make a camera of ours from another program's calibration file.",
    "mode": "Make the camera of another mode of the sensor: cropped, binned, scaled.",
    "evaluate": "Score a camera on photographs of a board.",
    "report": "Tell how good a camera is, on one page with everything in it.",
    "compare": "How far two cameras differ, in px over the image.",
    "board": "Print a board, true to scale.",
    "serve": "Calibrate in your browser, with photographs or a live camera.",
    "gray-code": "Make Gray codes for a screen, and decode photographs of them.",
    "simulate": "Render the paper's six data sets, with truth.",
    "reproduce": "Make the paper's tables and figures anew, beside its own numbers.",
    "demo": "See it work: render a warped scene, calibrate it, straighten it.",
}


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """All commands, in the order of a day's work."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"pinholify.cli.{cmd_name.replace('-', '_')}_command")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, without loading any."""
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
    """Run the command line and return its exit status: 0 done, 1 refused, 2 wrong usage, 130 interrupted."""
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
    except (BrokenPipeError, SystemExit):  # the reader has seen enough; click notices first and leaves this way
        _discard_output()
        return 0
    except PinholifyError as error:
        return _refuse(str(error))
    except MemoryError:
        return _refuse("there is not enough memory for images of this size; give smaller ones")
    except OSError as error:
        return _refuse(_sentence(error))


def _accept_any_character() -> None:
    """Write what a stream's encoding lacks as an escape, so that no sign in a name or number ends the work."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _refuse(sentence: str) -> int:
    click.echo(f"pinholify: {sentence}", err=True)
    return 1


def _sentence(error: OSError) -> str:
    """What to say of an error no reader or writer of files has put into words: a stream's, or a folder's."""
    if error.filename is not None:
        return f"'{error.filename}' cannot be used: {error.strerror}; check the path and its permissions"
    from pinholify.io.files import cannot_write

    _discard_output()
    return str(cannot_write("standard output", error))


def _discard_output() -> None:
    """Send what is still to be written to standard output nowhere, or Python would fail on it once more at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
