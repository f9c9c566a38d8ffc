"""Hyperparameters by maximum marginal likelihood: L-BFGS with analytic gradients, from several starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from pinholify.arrays import Floats
from pinholify.gp.kernels import Kernel
from pinholify.gp.regression import Data, GaussianProcess, condition, likelihood_and_gradient

TRIAL_STEPS = 10  # of each start
MAXIMUM_STEPS = 1000  # of the best of them


@dataclass(frozen=True, slots=True)
class SearchRange:
    """Bounds and priors of the search, in units of the inputs (length scale) and of the targets (std and noise).

    ``shortest`` is a weak prior against length scales that the points cannot resolve, exp(−shortest/l) for each
    (the penalised-complexity prior of Fuglstad et al. 2019): the likelihood of data without a signal is flat, and
    without the prior the search may end at a GP that imitates the noise. ``largest`` is the same paper's prior against
    a large signal, exp(−std/largest).
    """

    std: tuple[float, float] = (1e-4, 1e3)
    length_scale: tuple[float, float] = (1e-2, 1e2)
    noise_std: tuple[float, float] = (1e-6, 1e1)
    shape: tuple[float, float] = (1e-2, 1e4)
    shortest: float = 0.0
    largest: float = np.inf

    def penalty(self, kernel: Kernel) -> tuple[float, Floats]:
        """Minus the log prior, and its derivative by the kernel's first log parameters: std and length scales."""
        scales = self.shortest / kernel.length_scale
        std = kernel.std / self.largest
        return float(scales.sum() + std), np.concatenate([[std], -scales])

    def log_bounds(self, kernel: Kernel) -> list[tuple[float, float]]:
        """Bounds of the kernel's log parameters and of log noise std, in this order."""
        scales = [self.length_scale] * len(kernel.length_scale)
        rest = [self.shape] * (len(kernel.log_parameters) - 1 - len(scales))
        return [(float(np.log(a)), float(np.log(b))) for a, b in [self.std, *scales, *rest, self.noise_std]]


@dataclass(frozen=True, slots=True)
class Start:
    """One start of the search: signal and noise std in units of the targets, length scale in units of the inputs."""

    std: float
    length_scale: float
    noise_std: float

    def log_parameters(self, kernel: Kernel) -> Floats:
        """This start as the kernel's log parameters and log noise std; shape parameters keep the kernel's values."""
        parameters = kernel.log_parameters.copy()
        parameters[0] = np.log(self.std)
        parameters[1 : 1 + len(kernel.length_scale)] = np.log(self.length_scale)
        return np.append(parameters, np.log(self.noise_std))


def maximise_likelihood(
    kernel: Kernel,
    observed: Data,
    *,
    starts: Sequence[Start],
    search: SearchRange = SearchRange(),
) -> GaussianProcess:
    """The GP of the highest log marginal likelihood of ``observed`` found from ``starts``."""
    squared_differences = kernel.squared_differences(observed.x, observed.x)
    bounds = search.log_bounds(kernel)
    low, high = np.array(bounds).T

    def loss(parameters: Floats) -> tuple[float, Floats]:
        trial = kernel.with_log_parameters(parameters[:-1])
        try:
            value, gradient = likelihood_and_gradient(
                trial, float(np.exp(parameters[-1])), observed, squared_differences
            )
        except np.linalg.LinAlgError:  # not positive definite in double precision: turn the search away
            return 1e25, np.zeros_like(parameters)
        penalty, slope = search.penalty(trial)
        gradient[: len(slope)] -= slope
        return penalty - value, -gradient

    def descend(parameters: Floats, steps: int) -> Any:
        return minimize(loss, parameters, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps})

    # Most starts lead to the same maximum, so each takes a few steps and only the best goes on to convergence.
    trials = [descend(np.clip(start.log_parameters(kernel), low, high), TRIAL_STEPS) for start in starts]
    best = descend(min(trials, key=lambda run: float(run.fun)).x, MAXIMUM_STEPS).x
    return condition(kernel.with_log_parameters(best[:-1]), float(np.exp(best[-1])), observed)
