"""Memory that was freed is kept where the C library can be told to."""

import platform
import subprocess
import sys

import pytest

from pinholify.io.memory import keep_freed_memory

FAULTS = """
import resource
import numpy as np
from pinholify.io.memory import keep_freed_memory
if {kept}:
    keep_freed_memory()
a = np.ones(30_000)
for turn in range(300):
    if turn == 100:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    (a + 1.0) * (a + 2.0) * (a + 3.0) + (a + 4.0)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def faults(*, kept: bool) -> int:
    code = FAULTS.format(kept=kept)
    return int(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library is left as it is")
def test_arrays_come_from_what_was_freed() -> None:
    """Without it the system clears the pages of each array anew."""
    assert faults(kept=True) < 100
    assert faults(kept=False) > 1000


def test_other_c_libraries_are_left_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda name: object())
    keep_freed_memory()
