"""The directive ``commands``: every command with its options and examples, taken from click at build time."""

from __future__ import annotations

import inspect
from typing import Any

import click
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from pinholify.cli import cli

WITHOUT_BREAKS = "\b"
"""click's mark before a paragraph that is not re-wrapped."""


class Commands(SphinxDirective):
    """A section for each command and, within those of groups, for each of their commands."""

    def run(self) -> list[nodes.Node]:
        """The sections."""
        with click.Context(cli, info_name="pinholify", **cli.context_settings) as context:
            return self._sections(cli, context)

    def _sections(self, group: click.Group, parent: click.Context) -> list[nodes.Node]:
        found = []
        for name in group.list_commands(parent):
            command = group.get_command(parent, name)
            assert command is not None  # it was listed
            with click.Context(command, info_name=name, parent=parent) as context:
                found.append(self._section(command, context))
        return found

    def _section(self, command: click.Command, context: click.Context) -> nodes.section:
        title = context.command_path
        section = nodes.section(names=[title.replace(" ", "-")])
        section += nodes.title(text=title)
        self.state.document.note_explicit_target(section, section)
        usage = " ".join([title, *command.collect_usage_pieces(context)])
        section += nodes.literal_block(usage, usage, language="none")
        section += [_paragraph(text) for text in _paragraphs(command.help)]
        section += _options(command, context)
        section += [_paragraph(text) for text in _paragraphs(command.epilog)]
        if isinstance(command, click.Group):
            section += self._sections(command, context)
        return section


def _paragraphs(text: str | None) -> list[str]:
    return inspect.cleandoc(text).split("\n\n") if text else []


def _paragraph(text: str) -> nodes.Element:
    if text.startswith(WITHOUT_BREAKS):
        lines = text.removeprefix(WITHOUT_BREAKS).strip("\n")
        return nodes.literal_block(lines, lines, language="none")
    return nodes.paragraph(text=" ".join(text.split()))


def _options(command: click.Command, context: click.Context) -> list[nodes.Node]:
    options = [parameter for parameter in command.params if isinstance(parameter, click.Option)]
    listed = nodes.definition_list()
    for names, help_text in filter(None, (option.get_help_record(context) for option in options)):
        term = nodes.term("", "", nodes.literal(text=names))
        listed += nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph(text=help_text)))
    return [listed]


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer the directive."""
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
