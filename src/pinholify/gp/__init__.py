"""Gaussian-process regression of smooth maps of the plane. Knows no cameras and no boards."""
