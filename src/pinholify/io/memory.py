"""Tuning of the C library's memory allocation."""

from __future__ import annotations

import ctypes

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3  # glibc's malloc.h
KEPT = 256 * 2**20  # bytes
MAX_ARRAY_BYTES = 32 * 2**20  # bytes; the largest array taken from kept memory, and glibc's maximum
AHEAD = 16 * 2**20  # bytes


def keep_freed_memory() -> None:
    """Let glibc keep freed memory for the next array; other C libraries are left unchanged.

    A solve creates and frees arrays of a few hundred kB thousands of times. By default glibc returns such memory to the
    system at once, and the system then clears each page of the next array again, which takes longer than using it
    (mallopt(3)).
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library; on Windows CDLL(None) fails
        return
    for parameter, value in ((TRIM_THRESHOLD, KEPT), (MMAP_THRESHOLD, MAX_ARRAY_BYTES), (TOP_PAD, AHEAD)):
        mallopt(parameter, value)
