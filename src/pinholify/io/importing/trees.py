"""Text files of calibrations as plain dictionaries, lists, numbers and texts: the small part of YAML and XML they use.

Written for files that are not trusted: nothing is run, made or expanded, and depth is limited. (OpenCV's own reader
ends the process on some files, and does not read all YAML.)
"""

from __future__ import annotations

import ast
import re
from collections import deque
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

DEEPEST = 12
KEY = re.compile(r"(\"[^\"]*\"|'[^']*'|[^\s:#\[\]{}\"'-][^:]*?)\s*:(?:\s+(.*))?$")
COMMENT = re.compile(r"(^|\s)#.*$")
TAG = re.compile(r"^!\S+\s*")

Line = tuple[int, str]
"""Indentation and text."""


def yaml_tree(text: str) -> Any:
    """The content of YAML ``text`` of mappings, lists and plain values; raises ValueError for what is beyond them."""
    lines = deque(_logical_lines(text))
    if not lines:
        raise ValueError("nothing in it")
    tree = _block(lines, 0)
    if lines:
        raise ValueError(f"not understood: {lines[0][1]}")
    return tree


def _logical_lines(text: str) -> Iterator[Line]:
    """Lines without comments and directives, the parts of a list in brackets joined."""
    parts: list[str] = []
    still_open = 0
    for raw in text.splitlines():
        line = COMMENT.sub("", raw).rstrip()
        if not line.strip() or line.startswith(("%", "---", "...")):
            continue
        parts.append(line if not parts else line.strip())
        still_open += line.count("[") - line.count("]")
        if still_open <= 0:
            yield len(parts[0]) - len(parts[0].lstrip()), " ".join(parts).strip()
            parts, still_open = [], 0
    if parts:
        raise ValueError(f"a bracket is not closed: {parts[0].strip()}")


def _block(lines: deque[Line], depth: int) -> Any:
    """The mapping or list that ``lines`` begin with, taken from them."""
    if depth > DEEPEST:
        raise ValueError("nested too deeply")
    indent, first = lines[0]
    block = _items(lines, indent, depth) if first.startswith("- ") else _mapping(lines, indent, depth)
    if not block:
        raise ValueError(f"not understood: {first}")
    return block


def _mapping(lines: deque[Line], indent: int, depth: int) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    while lines and lines[0][0] == indent and (match := KEY.match(lines[0][1])):
        lines.popleft()
        key, value = match[1].strip("\"'"), TAG.sub("", match[2] or "")
        # A list may stand as far to the left as the key it belongs to.
        belongs = bool(lines) and (lines[0][0] > indent or (lines[0][0] == indent and lines[0][1].startswith("- ")))
        mapping[key] = _block(lines, depth + 1) if belongs and not value else _plain(value)
    return mapping


def _items(lines: deque[Line], indent: int, depth: int) -> list[Any]:
    items: list[Any] = []
    while lines and lines[0][0] == indent and lines[0][1].startswith("- "):
        text = lines.popleft()[1]
        inner = text[2:].lstrip()
        if inner.startswith("- ") or KEY.match(inner):
            lines.appendleft((indent + len(text) - len(inner), inner))
            items.append(_block(lines, depth + 1))
        else:
            items.append(_plain(inner))
    return items


def _plain(text: str) -> Any:
    """A number or a list of numbers, or else the text itself."""
    try:
        return ast.literal_eval(text)
    except (ValueError, SyntaxError):
        return text.strip("\"'") or None


def xml_tree(text: str) -> Any:
    """The content of XML ``text`` as OpenCV writes it; raises ValueError for what it never writes."""
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise ValueError("declarations are not read")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from None
    return _element(root, 0)


def _element(element: ElementTree.Element, depth: int) -> Any:
    if depth > DEEPEST:
        raise ValueError("nested too deeply")
    if len(element):
        return {child.tag: _element(child, depth + 1) for child in element}
    words = (element.text or "").split()
    values = [_plain(word) for word in words]
    return values[0] if len(values) == 1 else values
