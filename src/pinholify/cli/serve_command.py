"""The command ``pinholify serve``."""

from __future__ import annotations

from pathlib import Path

import click

from pinholify.cli.options import examples, say
from pinholify.errors import InputError

NEEDED = ("fastapi", "uvicorn")
LOOPBACK = frozenset(["127.0.0.1", "localhost", "::1"])


@click.command("serve", epilog=examples("pinholify serve", "pinholify serve --port 8000 --folder sessions/ --no-open"))
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Port to listen on; by default any free one.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--folder", type=click.Path(path_type=Path, file_okay=False),
              help="Where sessions are kept; by default your own data folder.")
@click.option("--open/--no-open", "browser", default=True, show_default=True, help="Open the page in your browser.")
def command(port: int, host: str, folder: Path | None, browser: bool) -> None:
    """Calibrate in your browser: drop photographs, or hold a board in front of the camera. Ctrl-C ends it.

    By default only this computer can reach the page, and only by the printed address with its token. Photographs stay
    in the folder until you delete their session.
    """
    try:
        from pinholify.web.server import serve
    except ModuleNotFoundError as error:
        if error.name not in NEEDED:
            raise
        raise InputError("the app needs more packages; install them with: pip install 'pinholify[app]'") from None
    if host not in LOOPBACK:
        say(f"note: everyone who can reach {host} and has the address can use the app; the connection is not encrypted")
    place = folder or Path(click.get_app_dir("pinholify")) / "sessions"
    serve(place, host, port, browser=browser, announce=lambda address: click.echo(f"pinholify is at {address}"))
