"""Straightening one picture from its source to its target, and the stamp that identifies the result."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

import pinholify
from pinholify.batch.jobs import Job
from pinholify.errors import ImageError
from pinholify.io import places, stamps
from pinholify.io.images import decode_image, encode_image
from pinholify.rectification.straightener import Straightener


@dataclass(frozen=True, slots=True)
class Straightening:
    """Does a :class:`Job` when called; small enough to send to other processes, each of which builds its map once.

    ``identity`` (hexadecimal digits) is a digest of the camera, the view and every option of ``straightener``. With
    ``again`` a picture that is already finished is done again.
    """

    straightener: Straightener = field(compare=False)
    identity: str
    again: bool = False

    def __call__(self, job: Job) -> None:
        """Read, straighten and write, unless ``job`` is finished: a cluster may repeat a job when a worker dies.

        Raises ImageError, which names the source, if that is not an image of the camera, and OutputError if the target
        cannot be written.
        """
        data = places.read_bytes(job.source)
        stamp = self.stamp(job.source, len(data))
        if not self.again and stamp == _standing_stamp(job.target):
            return
        image = decode_image(data, job.source, keep_alpha=True)
        try:
            straight = _first_like(self).straightener(image)
        except ImageError as error:
            raise ImageError(f"'{job.source}': {error}") from None
        places.write_bytes(job.target, stamps.stamped(encode_image(straight, job.target), stamp))

    def stamp(self, source: str, size: int | None) -> str:
        """The stamp (32 hexadecimal digits) of the picture made from ``source`` of ``size`` bytes."""
        text = "\n".join([self.identity, places.name_of(source), str(size)])
        return hashlib.sha256(text.encode()).hexdigest()[:32]

    def standing(self, jobs: Sequence[Job]) -> dict[str, bool]:
        """The existing targets of ``jobs``, each with whether this work wrote it from its source."""
        found = places.beginnings([job.target for job in jobs], stamps.REACH)
        there = [(job, beginning) for job, beginning in zip(jobs, found, strict=True) if beginning is not None]
        sizes = places.sizes([job.source for job, _ in there])
        return {
            job.target: stamps.stamp_of(beginning) == self.stamp(job.source, size)
            for (job, beginning), size in zip(there, sizes, strict=True)
        }


def straightening(straightener: Straightener, *, again: bool = False) -> Straightening:
    """The work of straightening pictures with ``straightener``."""
    digest = hashlib.sha256(pinholify.__version__.encode())
    _digest(digest, straightener)
    return Straightening(straightener, digest.hexdigest(), again)


@lru_cache(maxsize=1)
def _first_like(work: Straightening) -> Straightening:
    """The first of equal works in this process, which has built its map: every job may come with a copy of its own."""
    return work


def _standing_stamp(target: str) -> str | None:
    (beginning,) = places.beginnings([target], stamps.REACH)
    return None if beginning is None else stamps.stamp_of(beginning)


def _digest(digest: Any, value: Any) -> None:
    """Feed ``value`` into ``digest``; raises TypeError for a value whose text does not identify it."""
    if dataclasses.is_dataclass(value):
        digest.update(type(value).__name__.encode())
        _digest(digest, {field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    elif isinstance(value, np.ndarray):
        digest.update(f"{value.dtype.str}{value.shape}".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, Mapping):
        _digest(digest, list(value.items()))
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)}".encode())
        for item in value:
            _digest(digest, item)
    elif value is None or isinstance(value, str | int | float | np.generic):
        digest.update(repr(value).encode())
    else:
        raise TypeError(f"a {type(value).__name__} has no stable identity")
