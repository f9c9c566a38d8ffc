"""Calibration of the virtual camera by a simplified Zhang's method (paper, appendix B)."""
