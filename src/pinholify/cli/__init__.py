"""The command line. Each command is a module, loaded only when it is called, so that ``--help`` answers at once."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any

import click

from pinholify import __version__
from pinholify.errors import PinholifyError

COMMANDS = {
    "detect": "Find the corners of a board in photographs.",
    "calibrate": "Make a perfect pinhole camera from photographs of a board.",
    "map": "Map points between pixels, the virtual plane and rays.",
    "undistort": "Straighten photographs.",
    "evaluate": "Score a camera on photographs of a board.",
    "board": "Print a board, true to scale.",
    "simulate": "Render the paper's six data sets, with truth.",
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
        module = importlib.import_module(f"pinholify.cli.{cmd_name}_command")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, without loading any."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Example: pinholify calibrate photos/ --board 15x9 -o camera.npz && "
    "pinholify undistort camera.npz photos/ -o straight/",
)
@click.version_option(__version__, prog_name="pinholify")
def cli() -> None:
    """Turn any camera into a perfect pinhole camera: no lens model, straight lines straight, honest error bars."""


def main(arguments: list[str] | None = None) -> Any:
    """Run the command line: exit status 0 done, 1 refused, 2 wrong usage, 130 interrupted."""
    # The matrices here are small: threads in BLAS cost more than they bring. Must be set before NumPy loads.
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    try:
        return cli.main(arguments, prog_name="pinholify", standalone_mode=False) or 0
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("pinholify: interrupted", err=True)
        sys.exit(130)
    except PinholifyError as error:
        click.echo(f"pinholify: {error}", err=True)
        sys.exit(1)
    except BrokenPipeError:  # the reader of our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except MemoryError:
        click.echo("pinholify: there is not enough memory for images of this size; give smaller ones", err=True)
        sys.exit(1)
