"""The provenance of a camera: its file, and the software that wrote it and when."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True)
class Provenance:
    """The name of the camera ``file``, its SHA-256, the ``software`` that wrote it, and when (``created``, UTC)."""

    file: str
    sha256: str
    software: str
    created: str


def provenance_of(path: Path) -> Provenance:
    """The provenance of the camera file ``path``, which :func:`~pinholify.io.camera_file.read_camera` has read."""
    with np.load(path, allow_pickle=False) as archive:
        header: dict[str, Any] = json.loads(archive["header"].tobytes())
    written = header.get("provenance", {})
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    return Provenance(path.name, digest, str(written.get("software", "")), str(written.get("created", "")))
