"""A report as JSON: the fields of :class:`~pinholify.report.contents.Report` and its parts, without pictures."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np

from pinholify.report.contents import Report

FORMAT, FORMAT_VERSION = "pinholify-report", 1
PICTURES = ("frames", "thumbnail")


def render(report: Report) -> str:
    """``report`` as JSON text."""
    return json.dumps(as_object(report), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_object(report: Report) -> dict[str, Any]:
    """The report as dicts, lists, numbers and strings; numbers that are not finite become None."""
    return {"format": FORMAT, "format_version": FORMAT_VERSION, **_plain(report)}


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if dataclasses.is_dataclass(value):
        names = (field.name for field in dataclasses.fields(value))
        return {name: _plain(getattr(value, name)) for name in names if name not in PICTURES}
    if isinstance(value, dict):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
