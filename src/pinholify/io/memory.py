"""What becomes of memory that was freed."""

from __future__ import annotations

import ctypes

TRIM_THRESHOLD, TOP_PAD, MMAP_THRESHOLD = -1, -2, -3  # glibc's malloc.h
KEPT = 256 * 2**20  # bytes
LARGEST = 32 * 2**20  # bytes of an array that comes from what is kept; more glibc does not allow
AHEAD = 16 * 2**20  # bytes


def keep_freed_memory() -> None:
    """Let the C library keep what was freed for the next array, where it is glibc; others are left as they are.

    A solve makes and frees arrays of a few hundred kB thousands of times. By default glibc gives such memory back at
    once, and the system then clears each page of the next array anew, which takes longer than to work with it
    (mallopt(3)).
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library; Windows has no name for all that is loaded
        return
    for parameter, value in ((TRIM_THRESHOLD, KEPT), (MMAP_THRESHOLD, LARGEST), (TOP_PAD, AHEAD)):
        mallopt(parameter, value)
