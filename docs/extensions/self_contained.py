"""After the build: a warning for each page that would fetch a script, style, font or picture from elsewhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)

FETCHED = re.compile(
    r"""<(?:script|img|iframe|source|video)\b[^>]*\bsrc="((?:https?:)?//[^"]+)"|"""
    r"""<link\b[^>]*\brel="(?:stylesheet|preload|icon)"[^>]*\bhref="((?:https?:)?//[^"]+)"|"""
    r"""(?:@import\s*|url\()["']?((?:https?:)?//[^"')]+)"""
)


def _check(app: Sphinx, exception: Exception | None) -> None:
    if exception is not None or app.builder.format != "html":
        return
    for path in sorted(Path(app.outdir).rglob("*")):
        if path.suffix in (".html", ".css"):
            for match in FETCHED.finditer(path.read_text(encoding="utf-8")):
                LOGGER.warning("%s fetches %s", path.relative_to(app.outdir), match[1] or match[2] or match[3])


def setup(app: Sphinx) -> dict[str, Any]:
    """Check when all is written."""
    app.connect("build-finished", _check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
