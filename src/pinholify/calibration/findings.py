"""What a calibration found besides the camera, with types.

The details of a calibration are plain values, as its file holds them: a file may be older, or come from another method
or program. Here they get names and types once, so that nobody else has to ask what they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Findings:
    """Fields are named as in :attr:`Calibration.details`; what a method does not find is None or empty.

    By image: why ``dropped_boards`` were not used, ids of ``wrong_corners``, what was done to ``renumbered_boards``.
    ``log_evidence`` is by trend; ``kernel_px`` is (standard deviation, length scales). ``board_bow_squares``,
    ``board_stretch``, ``board_shear`` and ``board_warp_squares`` describe a board that is not flat or not square;
    ``motion_px`` is the RMS motion of boards per axis during a rolling shutter, ``disagreement`` the factor ≥ 1 by
    which boards disagree more than noise explains; with ``too_few_boards`` there are too few to find out why.
    ``start_fits`` says whether a start explained the corners, ``board_known`` whether an imported camera has a board.
    """

    log_evidence: Mapping[str, float]
    singular_values: tuple[float, ...]
    kernel_px: tuple[float, ...]
    dropped_boards: Mapping[str, str]
    renumbered_boards: Mapping[str, str]
    wrong_corners: Mapping[str, tuple[int, ...]]
    board_bow_squares: float | None
    board_stretch: float | None
    board_shear: float | None
    board_warp_squares: float | None
    motion_px: float
    disagreement: float
    too_few_boards: bool
    start_fits: bool | None
    board_known: bool | None


def findings_of(details: Mapping[str, object]) -> Findings:
    """``details`` with types; values of other types count as missing."""
    return Findings(
        {name: float(v) for name, v in _table(details, "log_evidence").items() if isinstance(v, (int, float))},
        _numbers(details, "singular_values"),
        _numbers(details, "kernel_px"),
        {name: str(reason) for name, reason in _table(details, "dropped_boards").items()},
        {name: str(note) for name, note in _table(details, "renumbered_boards").items()},
        {name: tuple(ids) for name, ids in _table(details, "wrong_corners").items() if isinstance(ids, (list, tuple))},
        _number(details, "board_bow_squares"),
        _number(details, "board_stretch"),
        _number(details, "board_shear"),
        _number(details, "board_warp_squares"),
        _number(details, "motion_px") or 0.0,
        _number(details, "disagreement") or 1.0,
        details.get("too_few_boards") is True,
        _truth(details, "start_fits"),
        _truth(details, "board_known"),
    )


def _table(details: Mapping[str, object], key: str) -> dict[str, object]:
    value = details.get(key)
    return value if isinstance(value, dict) else {}


def _number(details: Mapping[str, object], key: str) -> float | None:
    value = details.get(key)
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None


def _numbers(details: Mapping[str, object], key: str) -> tuple[float, ...]:
    value = details.get(key)
    return tuple(float(each) for each in value) if isinstance(value, (list, tuple)) else ()


def _truth(details: Mapping[str, object], key: str) -> bool | None:
    value = details.get(key)
    return value if isinstance(value, bool) else None
