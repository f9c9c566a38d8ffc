"""Details from any file become findings with types; what has the wrong type is missing."""

from pinholify.calibration.findings import findings_of


def test_nothing_is_found_in_nothing():
    found = findings_of({})
    assert (found.motion_px, found.disagreement, found.too_few_boards) == (0.0, 1.0, False)
    assert (found.board_bow_squares, found.start_fits, found.board_known) == (None, None, None)
    assert not found.log_evidence
    assert not found.wrong_corners
    assert found.kernel_px == ()


def test_values_are_those_of_the_details():
    details = {"board_bow_squares": 0.25, "motion_px": 1, "kernel_px": [2.0, 300], "log_evidence": {"plane:0": -3}}
    found = findings_of({**details, "start_fits": False, "wrong_corners": {"a.png": [1, 2]}, "disagreement": 2.5})
    assert (found.board_bow_squares, found.motion_px, found.kernel_px) == (0.25, 1.0, (2.0, 300.0))
    assert found.log_evidence == {"plane:0": -3.0}
    assert found.start_fits is False
    assert found.wrong_corners == {"a.png": (1, 2)}
    assert found.disagreement == 2.5


def test_a_foreign_file_does_no_harm():
    details = {"motion_px": "fast", "wrong_corners": [1], "kernel_px": 3, "start_fits": "no", "log_evidence": None}
    assert findings_of(details) == findings_of({})
