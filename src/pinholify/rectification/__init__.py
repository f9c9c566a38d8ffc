"""Pinhole views of a calibrated camera, and the maps that make them from its images."""
