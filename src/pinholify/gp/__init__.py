"""Gaussian-process regression of smooth maps of the plane, with no notion of cameras or boards.

In reading order:

- ``kernels``: covariance functions
- ``regression``: exact Gaussian processes with a linear part
- ``hyperparameters``: their maximum-likelihood search
- ``trends``: parametric maps of the plane
- ``maps``: a trend and a process together, as a map with its inverse and its uncertainty
- ``fitting``: such maps fitted to pairs of points
"""
