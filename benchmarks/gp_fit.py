"""Fitting a GP to 135 corners: ours against scikit-learn's, in one run, with the same starts.

    python benchmarks/gp_fit.py

Both maximise the log marginal likelihood of both outputs of one board, squared exponential plus noise, from three
starts each. Prints the likelihoods, which must agree, and the ratio of the times (medians of five runs each).
"""

import os

for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import time
import warnings

import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from pinholify.gp.hyperparameters import Start, maximise_likelihood
from pinholify.gp.kernels import SquaredExponential
from pinholify.gp.regression import data

RUNS = 5
STARTS = [Start(0.7, 0.7, 1e-3), Start(2.0, 1.5, 1e-3), Start(10.0, 3.0, 1e-3)]


def board(seed):
    """Normalised pixels of a 15x9 board seen through barrel distortion, and its normalised lattice."""
    lattice = np.stack(np.meshgrid(np.arange(15.0), np.arange(9.0)), -1).reshape(-1, 2)
    y = (lattice - [7.0, 4.0]) / np.hypot(7, 4)
    x = y * (1 - 0.1 * (y**2).sum(axis=1, keepdims=True))
    return x + 1e-4 * np.random.default_rng(seed).normal(size=x.shape), y


def ours(x, y):
    gps = [maximise_likelihood(SquaredExponential(), data(x, column[:, None]), starts=STARTS) for column in y.T]
    return sum(gp.log_marginal_likelihood for gp in gps)


def theirs(x, y):
    total = 0.0
    for column in y.T:
        best = -np.inf
        for start in STARTS:
            kernel = ConstantKernel(start.std**2, (1e-8, 1e6)) * RBF(start.length_scale, (1e-2, 1e2))
            kernel = kernel + WhiteKernel(start.noise_std**2, (1e-12, 1e2))
            model = GaussianProcessRegressor(kernel, alpha=0.0, n_restarts_optimizer=0).fit(x, column)
            best = max(best, model.log_marginal_likelihood_value_)
        total += best
    return total


def main():
    warnings.simplefilter("ignore")  # scikit-learn warns of parameters near their bounds
    times = {"pinholify": [], "scikit-learn": []}
    for seed in range(RUNS):
        x, y = board(seed)
        for name, fit in (("pinholify", ours), ("scikit-learn", theirs)):
            start = time.perf_counter()
            likelihood = fit(x, y)
            times[name].append(time.perf_counter() - start)
            print(f"{name:13s} seed {seed}: log likelihood {likelihood:.3f}")
    ratio = np.median(times["scikit-learn"]) / np.median(times["pinholify"])
    print(f"scikit-learn takes {ratio:.1f} times as long")


if __name__ == "__main__":
    main()
