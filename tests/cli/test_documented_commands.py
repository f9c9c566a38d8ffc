"""Every command line of the pages is one that the program understands."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from pinholify.cli import cli

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("docs/*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"])


def command_lines(text):
    """The calls of the program in a page's blocks, fenced or indented, and between backticks."""
    blocks = re.findall(r"^```(?:sh)?\n(.*?)^```|((?:^    .*\n)+)", text, flags=re.DOTALL | re.MULTILINE)
    lines = "".join(map("".join, blocks)).replace("\\\n", " ").splitlines()
    lines += re.findall(r"`(pinholify [^`]*)`", text)
    return [line.strip() for line in lines if line.strip().startswith("pinholify ")]


def understand(line):
    """Raises click.UsageError on what the program does not know; nothing is run."""
    words = shlex.split(line, comments=True)[1:]
    command = cli
    context = parent = click.Context(cli, info_name="pinholify", **cli.context_settings)
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        name = words.pop(0)
        found = command.get_command(context, name)
        if found is None:
            raise click.UsageError(f"there is no command '{name}'")
        command, parent, context = found, context, click.Context(found, info_name=name, parent=context)
    if not isinstance(command, click.Group):
        command.make_context(command.name, words, parent=parent)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_command_lines(page):
    text = page.read_text(encoding="utf-8")
    for line in command_lines(text):
        try:
            understand(line)
        except click.MissingParameter:
            assert f"`{line}`" in text  # speaks of the command, and calls nothing
        except click.UsageError as error:
            pytest.fail(f"{page.name}: {line}: {error.format_message()}")


def test_commands_are_found_and_wrong_ones_refused():
    page = "```sh\npinholify board 9x6 \\\n    --square 25mm   # a board\nls\n```\n\n    pinholify nonsense\n"
    right, wrong = command_lines(page)
    understand(right)
    for line in (wrong, right.replace("--square", "--nonsense"), "pinholify board 9x6"):
        with pytest.raises(click.UsageError):
            understand(line)
