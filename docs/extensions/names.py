"""Turn names in backticks, such as ``pinholify.points.solve_pnp``, into links that can wrap at their dots."""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

NAME = re.compile(r"pinholify(\.\w+)+")
BREAK = nodes.raw("", "<wbr>", format="html")


def _link(app: Sphinx, document: nodes.document) -> None:
    """Turn such literals of a page into references; the build warns if there is no such name."""
    for literal in list(document.findall(nodes.literal)):
        name = literal.astext()
        if NAME.fullmatch(name) and not isinstance(literal.parent, (nodes.reference, addnodes.pending_xref)):
            literal.replace_self(
                addnodes.pending_xref(
                    "", _breakable(name), refdomain="py", reftype="obj", reftarget=name, refdoc=app.env.docname
                )
            )


def _breakable(name: str) -> nodes.literal:
    first, *rest = name.split(".")
    parts: list[nodes.Node] = [nodes.Text(first)]
    for part in rest:
        parts += [BREAK.deepcopy(), nodes.Text("." + part)]
    return nodes.literal("", "", *parts)


def setup(app: Sphinx) -> dict[str, Any]:
    """Link the names of every page that is read."""
    app.connect("doctree-read", _link)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
