"""The camera file: an ``.npz`` archive with a JSON header and plain arrays, written and read without pickle.

``header`` holds the format version, provenance, and the calibration as nested objects in which every array is a
reference to another entry of the archive. Only the types in ``HOMES`` are ever built from a file, so a file cannot run
code. A new kernel, trend or map needs one more line there.
"""

from __future__ import annotations

import dataclasses
import importlib
import io
import json
import os
import zipfile
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np

import pinholify
from pinholify.board import Board, CircleGrid, parse_board
from pinholify.calibration.result import Calibration
from pinholify.corners import Corners, CornerSet
from pinholify.errors import CameraFileError, PinholifyError
from pinholify.io.files import atomic_path

FORMAT = "pinholify-camera"
FORMAT_VERSION = 3  # those before never left development
MAX_BYTES = 1 << 30

HOMES = {
    "AdditiveMap": "gp.maps",
    "AngleChart": "charts",
    "Angles": "refinement.trends.base",
    "Calibration": "calibration.result",
    "ConvexRegion": "geometry",
    "DisplacementMap": "gp.maps",
    "Domain": "camera",
    "GaussianProcess": "gp.regression",
    "Homography": "gp.trends",
    "ImageFrame": "refinement.observations",
    "Intrinsics": "charts",
    "JointMap": "refinement.maps",
    "Lens": "gp.trends",
    "LensTrend": "refinement.trends.radial",
    "Matern32": "gp.kernels",
    "Matern52": "gp.kernels",
    "Plane": "refinement.trends.base",
    "PlaneChart": "charts",
    "Polynomial": "gp.trends",
    "PolynomialTrend": "refinement.trends.polynomial",
    "RationalQuadratic": "gp.kernels",
    "Scaling": "gp.maps",
    "SensorMode": "modes",
    "Settings": "calibration.result",
    "SineBasis": "refinement.basis",
    "SplineMap": "splines",
    "SplineSurface": "splines",
    "SquaredExponential": "gp.kernels",
    "VirtualCamera": "camera",
}
"""Name of each type that a camera file may contain → its module, imported only when a file contains the type."""


def type_named(name: str) -> type[Any]:
    """The type called ``name`` in camera files; raises KeyError for one that they may not contain."""
    found: type[Any] = getattr(importlib.import_module(f"pinholify.{HOMES[name]}"), name)
    return found


def write_camera(path: str | os.PathLike[str], calibration: Calibration) -> None:
    """Write ``calibration`` to ``path`` (``.npz``), atomically; raises OutputError if that fails."""
    arrays: dict[str, Any] = {}
    header = {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "units": {
            "image": "px, integer = pixel centre",
            "virtual": calibration.unit,
            "square_mm": calibration.square_mm,
        },
        "board": calibration.corner_set.board.spec,
        "handedness": "mirrored" if calibration.camera.mirrored else "right-handed as seen in the image",
        "provenance": {
            "software": f"pinholify {pinholify.__version__}",
            "created": datetime.now(UTC).isoformat(timespec="seconds"),
            "images": [view.name for view in calibration.corner_set.views],
            "reference": calibration.reference,
        },
        "calibration": _encode(calibration, "calibration", arrays),
    }
    text = np.frombuffer(json.dumps(header, allow_nan=True).encode(), dtype=np.uint8)
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.savez_compressed(file, header=text, **arrays)


def read_camera(path: str | os.PathLike[str]) -> Calibration:
    """Read the calibration in ``path``; raises CameraFileError unless it is a complete pinholify camera file."""
    name = os.fspath(path)
    header, arrays = _load(Path(path))
    if header.get("format") != FORMAT:
        raise CameraFileError(f"'{name}' is not a pinholify camera; give a file that 'pinholify calibrate' wrote")
    version = header.get("format_version")
    if version != FORMAT_VERSION:
        remedy = "calibrate again" if version in range(FORMAT_VERSION) else "upgrade pinholify"
        found = f"'{name}' has camera format {version} and this pinholify reads {FORMAT_VERSION}"
        raise CameraFileError(f"{found}: {remedy}")
    try:
        return _checked(_decode(header["calibration"], arrays), header)
    except Exception as error:  # a damaged file can raise anything
        raise CameraFileError(
            f"'{name}' is damaged ({type(error).__name__}: {error}); calibrate again or fetch the file again"
        ) from None


def _checked(calibration: Any, header: dict[str, Any]) -> Calibration:
    """Return ``calibration`` after a trial of its camera; raises any error if it, its parts or its unit are wrong."""
    if not isinstance(calibration, Calibration):
        raise TypeError(f"a {type(calibration).__name__} where a calibration is needed")
    if header["units"]["virtual"] != calibration.unit:
        raise ValueError(f"its unit is {header['units']['virtual']} where {calibration.unit} is needed")
    hull = calibration.camera.domain.hull.vertices
    if not np.isfinite(calibration.camera.to_rays(hull).directions).all():
        raise ValueError("the camera sees nothing")
    return calibration


def is_camera_file(path: str | os.PathLike[str]) -> bool:
    """Whether ``path`` is a pinholify camera file, of any version."""
    try:
        return bool(_load(Path(path))[0].get("format") == FORMAT)
    except CameraFileError:
        return False


def _load(path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    if path.is_dir():
        raise CameraFileError(f"'{path}' is a folder where a camera file (.npz) is needed")
    if not path.exists():
        raise CameraFileError(f"there is no camera file '{path}'; check the path")
    try:
        arrays = _arrays(path)
        header = json.loads(arrays.pop("header").tobytes().decode())
    except PinholifyError:
        raise
    except OSError as error:
        raise CameraFileError(f"'{path}' cannot be read: {error.strerror or error}; check the file") from None
    except Exception:  # a foreign or damaged archive can raise many errors, none of interest to the user
        raise CameraFileError(
            f"'{path}' is not a pinholify camera, or is cut short; give a file that 'pinholify calibrate' wrote"
        ) from None
    return (header if isinstance(header, dict) else {}), arrays


def _arrays(path: Path) -> dict[str, Any]:
    """All arrays of an archive. Each entry is read to its end, or its checksum would not be verified."""
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > MAX_BYTES:
            raise CameraFileError(
                f"'{path}' would unpack to more than {MAX_BYTES >> 20} MiB and is not a pinholify camera; "
                "give a file that 'pinholify calibrate' wrote"
            )
        return {
            name.removesuffix(".npy"): np.lib.format.read_array(io.BytesIO(archive.read(name)), allow_pickle=False)
            for name in archive.namelist()
        }


# --- objects to JSON and back -----------------------------------------------------------------------------------


def _encode(value: Any, path: str, arrays: dict[str, Any]) -> Any:
    if isinstance(value, np.ndarray):
        arrays[path] = value
        return {"array": path}
    if isinstance(value, CornerSet):
        return _encode_corners(value, path, arrays)
    kind = type(value).__name__
    if kind in HOMES:
        if type(value) is not type_named(kind):
            raise TypeError(f"the {kind} of {type(value).__module__} cannot be kept: HOMES has another of this name")
        names = [field.name for field in dataclasses.fields(value)]
        return {"type": kind, "fields": {n: _encode(getattr(value, n), f"{path}.{n}", arrays) for n in names}}
    if isinstance(value, dict):
        return {"dict": {k: _encode(v, f"{path}.{k}", arrays) for k, v in value.items()}}
    if isinstance(value, (tuple, list)):
        return {"list": [_encode(v, f"{path}.{i}", arrays) for i, v in enumerate(value)]}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (str, int, float, bool, NoneType)):
        return value
    raise TypeError(f"a {kind} cannot be kept in a camera file; add it to HOMES")


def _decode(value: Any, arrays: dict[str, Any]) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[value["array"]]
    if "corners" in value:
        return _decode_corners(value["corners"], arrays)
    if "type" in value:
        return type_named(value["type"])(**{k: _decode(v, arrays) for k, v in value["fields"].items()})
    if "dict" in value:
        return {k: _decode(v, arrays) for k, v in value["dict"].items()}
    return tuple(_decode(v, arrays) for v in value["list"])


VIEW_TEXTS = ("name", "reason", "orientation_assumed", "ambiguous_offset")


def _encode_corners(corner_set: CornerSet, path: str, arrays: dict[str, Any]) -> dict[str, Any]:
    views = corner_set.views
    arrays[f"{path}.ids"] = np.concatenate([v.ids for v in views]) if views else np.empty(0, np.int64)
    arrays[f"{path}.uv"] = np.concatenate([v.uv for v in views]) if views else np.empty((0, 2))
    arrays[f"{path}.weights"] = np.concatenate([v.weights for v in views]) if views else np.empty(0)
    return {
        "corners": {
            "path": path,
            "board": corner_set.board.spec,
            "image_size": list(corner_set.image_size),
            "counts": [len(v) for v in views],
            "views": [{key: getattr(v, key) for key in VIEW_TEXTS} for v in views],
        }
    }


def _decode_corners(value: dict[str, Any], arrays: dict[str, Any]) -> CornerSet:
    board: Board = parse_board(value["board"])
    width, height = (int(n) for n in value["image_size"])
    parts = zip(value["views"], _split(value, arrays), strict=True)
    views = tuple(Corners(ids=i, uv=u, weights=w, **texts) for texts, (i, u, w) in parts)
    return CornerSet(board, (width, height), views, centred=isinstance(board, CircleGrid))  # calibrations hold centres


def _split(value: dict[str, Any], arrays: dict[str, Any]) -> Iterator[tuple[Any, Any, Any]]:
    """Ids (n,), pixels (n, 2) and weights (n,) of each view."""
    ends = np.cumsum(value["counts"])
    columns = [arrays[f"{value['path']}.{key}"] for key in ("ids", "uv", "weights")]
    if any(len(column) != (ends[-1] if len(ends) else 0) for column in columns):
        raise ValueError("the numbers of corners do not add up")
    return zip(*(np.split(column, ends)[:-1] for column in columns), strict=True)
