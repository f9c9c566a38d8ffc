"""The directive ``public-names``: the names in ``pinholify``, each with its first sentence and a link to its module."""

from __future__ import annotations

import inspect
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import pinholify


class PublicNames(SphinxDirective):
    """A definition list of ``pinholify.__all__``; each entry is a target for references to the short name."""

    def run(self) -> list[nodes.Node]:
        """The list."""
        listed = nodes.definition_list()
        for name in pinholify.__all__:
            made = getattr(pinholify, name)
            term = self._term(f"pinholify.{name}", f"pinholify.{pinholify._HOMES[name]}.{name}", made)
            sentence, _ = self.parse_inline(_first_paragraph(made))
            listed += nodes.definition_list_item("", term, nodes.definition("", nodes.paragraph("", "", *sentence)))
        return [listed]

    def _term(self, short: str, home: str, made: Any) -> nodes.term:
        link = addnodes.pending_xref(
            "", nodes.literal(text=short), refdomain="py", reftype="obj", reftarget=home, refexplicit=True, refwarn=True
        )
        term = nodes.term("", "", link, ids=[short])
        kind = "class" if inspect.isclass(made) else "function"
        self.env.domains.python_domain.note_object(short, kind, short, aliased=True, location=term)
        return term


def _first_paragraph(made: object) -> str:
    return " ".join((inspect.getdoc(made) or "").split("\n\n")[0].split())


def setup(app: Sphinx) -> dict[str, Any]:
    """Offer the directive."""
    app.add_directive("public-names", PublicNames)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
