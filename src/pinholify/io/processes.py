"""Worker processes: how they start, and that Ctrl-C is their parent's affair."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """No Ctrl-C inside; only a program's main thread can say so, others change nothing.

    Processes that are started inside inherit it: while they start, Ctrl-C is for the parent alone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def be_a_worker() -> None:
    """One thread a process, and Ctrl-C left to the parent, which ends the pool."""
    import cv2

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    cv2.setNumThreads(1)
