"""Camera calibration without a lens model: any camera becomes a perfect pinhole camera."""

__version__ = "0.1.0"
