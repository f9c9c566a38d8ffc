"""Calibration files as plain dictionaries, lists, numbers and strings: the small subset of YAML and XML they use.

Written for files that are not trusted: nothing is executed, constructed or expanded, and depth is limited. OpenCV's own
reader aborts the process on some files and does not read all YAML; a YAML library would be one more dependency, and
refuses OpenCV's ``%YAML:1.0`` and ``!!opencv-matrix``.
"""

from __future__ import annotations

import ast
import re
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

MAX_DEPTH = 12
KEY = re.compile(r"(\"[^\"]*\"|'[^']*'|[^\s:#\[\]{}\"'-][^:]*?)\s*:(?:\s+(.*))?$")
COMMENT = re.compile(r"(^|\s)#.*$")
TAG = re.compile(r"^!\S+\s*")
QUOTED = r"\"[^\"]*\"|'[^']*'"
FLOW_BEGINS = re.compile(r"(?:^\s*|[:-]\s+)(?:!\S+\s+)?[\[{]")
COLON = r":(?=[\s\[\]{}])|(?<=[\"']):"
FLOW_TOKEN = re.compile(rf"\s*([\[\]{{}},]|{COLON}|{QUOTED}|(?:[^\[\]{{}},:]|:(?![\s\[\]{{}}]))+)")
"""A bracket, a comma, the colon after a key, or a plain value in a collection in brackets."""

Line = tuple[int, str]
"""Indentation and text of a logical line."""


def yaml_tree(text: str) -> Any:
    """Parse YAML ``text`` made of mappings, lists and plain values; raises ValueError for anything else."""
    lines = deque(_logical_lines(text))
    if not lines:
        raise ValueError("it is empty")
    tree = _block(lines, 0)
    if lines:
        raise ValueError(f"not understood: {lines[0][1]}")
    return tree


def _logical_lines(text: str) -> Iterator[Line]:
    """Lines without comments and directives, with collections in brackets joined into one line."""
    parts: list[str] = []
    still_open = 0
    for raw in text.splitlines():
        line = COMMENT.sub("", raw).rstrip()
        if not line.strip() or line.startswith(("%", "---", "...")):
            continue
        parts.append(line if not parts else line.strip())
        if still_open or FLOW_BEGINS.search(line):
            plain = re.sub(QUOTED, "", line)
            still_open += sum(map(plain.count, "[{")) - sum(map(plain.count, "]}"))
        if still_open <= 0:
            yield len(parts[0]) - len(parts[0].lstrip()), " ".join(parts).strip()
            parts, still_open = [], 0
    if parts:
        raise ValueError(f"a bracket is not closed: {parts[0].strip()}")


def _block(lines: deque[Line], depth: int) -> Any:
    """Parse the mapping or list at the beginning of ``lines``, and remove it from them."""
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    indent, first = lines[0]
    if first.startswith(("[", "{")):
        return _plain(lines.popleft()[1])
    block = _items(lines, indent, depth) if first.startswith("- ") else _mapping(lines, indent, depth)
    if not block:
        raise ValueError(f"not understood: {first}")
    return block


def _mapping(lines: deque[Line], indent: int, depth: int) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    while lines and lines[0][0] == indent and (match := KEY.match(lines[0][1])):
        lines.popleft()
        key, value = match[1].strip("\"'"), TAG.sub("", match[2] or "")
        # A list may have the same indentation as its key.
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
    """A number or a collection in brackets, otherwise the text itself; raises ValueError for an odd bracket."""
    try:
        return ast.literal_eval(text)  # also for long lists of numbers, which it reads fast
    except (ValueError, SyntaxError):
        return _flow_tree(text) if text.startswith(("[", "{")) else text.strip("\"'") or None


def _flow_tree(text: str) -> Any:
    tokens = deque(token.strip() for token in FLOW_TOKEN.findall(text))
    tree = _flow(tokens, 0)
    if tokens:
        raise ValueError(f"not understood: {tokens[0]}")
    return tree


def _flow(tokens: deque[str], depth: int) -> Any:
    """Parse the value at the beginning of ``tokens``, and remove it from them; raises ValueError."""
    if depth > MAX_DEPTH or not tokens:
        raise ValueError("nested too deeply, or a bracket is not closed")
    first = tokens.popleft()
    if first == "[":
        return list(_members(tokens, "]", lambda: _flow(tokens, depth + 1)))
    if first == "{":
        return dict(_members(tokens, "}", lambda: _pair(tokens, depth + 1)))
    if first in "]},:":
        raise ValueError(f"not understood: {first}")
    return _plain(first)


def _members(tokens: deque[str], end: str, member: Callable[[], Any]) -> Iterator[Any]:
    while tokens and tokens[0] != end:
        yield member()
        if tokens and tokens[0] == ",":
            tokens.popleft()
        elif tokens and tokens[0] != end:
            raise ValueError(f"not understood: {tokens[0]}")
    if not tokens:
        raise ValueError("a bracket is not closed")
    tokens.popleft()


def _pair(tokens: deque[str], depth: int) -> tuple[str, Any]:
    key = tokens.popleft().strip("\"'")
    if not tokens or tokens.popleft() != ":":
        raise ValueError(f"no value for {key}")
    return key, _flow(tokens, depth)


def xml_tree(text: str) -> Any:
    """Parse XML ``text`` as OpenCV writes it; raises ValueError for anything else."""
    if "<!" in re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL):
        raise ValueError("declarations are not read")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(str(error)) from None
    return _element(root, 0)


def _element(element: ElementTree.Element, depth: int) -> Any:
    if depth > MAX_DEPTH:
        raise ValueError("nested too deeply")
    if len(element):
        return {child.tag: _element(child, depth + 1) for child in element}
    words = (element.text or "").split()
    values = [_plain(word) for word in words]
    return values[0] if len(values) == 1 else values
