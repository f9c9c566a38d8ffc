"""Calibrations that several tests share."""

import pytest

from synthetic import corner_set


@pytest.fixture(scope="session")
def barrel_set():
    """Nine views through barrel distortion with 0.1 px of noise."""
    return corner_set(squeeze=0.15)


@pytest.fixture(scope="session")
def barrel_calibration(barrel_set):
    """The one-image calibration of :func:`barrel_set`."""
    from pinholify.pipeline import calibrate

    return calibrate(barrel_set, reference="view0.png", method="one-image", trend="lens:3")
