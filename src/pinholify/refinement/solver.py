"""Levenberg-Marquardt on the joint model with the poses eliminated, and its robust loss.

The objective is the true one, residuals in px against the noise plus the priors: a step that does not lower
it is not taken. The damping is the solver's own; no evidence ever sees it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pinholify.arrays import Floats
from pinholify.refinement.model import Linearisation, Model, Prediction, State
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import Observations

FIRST_DAMPING = 1e-5
LEAST_DAMPING, MOST_DAMPING = 1e-9, 1e6
TRUSTED_DAMPING = 1e-2  # a small gain under a stronger damping is no sign of convergence
LEAST_NOISE = 1e-9  # normalised image units
RAYLEIGH_MEDIAN = float(np.sqrt(2.0 * np.log(2.0)))  # of a residual's length, in standard deviations per axis


@dataclass(frozen=True, slots=True)
class Loss:
    """Noise ``std`` per axis (normalised) and where Huber's loss turns linear, in standard deviations.

    ``std`` None: the scale of the residuals at each step, by their median.
    """

    std: float | None = None
    huber: float = np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where a search stands: the model, its state there and what it predicts, the objective (nats) and the
    noise it is measured with.
    """

    model: Model
    state: State
    prediction: Prediction
    objective: float
    noise: float


def lengths(residual: Floats, weight: Floats) -> Floats:
    """Lengths (n,) of residuals (n, 2), whitened by each corner's ``weight`` (n,)."""
    return np.asarray(np.linalg.norm(residual, axis=1) * weight)


def robust_scale(length: Floats) -> float:
    """Standard deviation per axis, by the median of the residuals' lengths (n,)."""
    return float(np.median(length)) / RAYLEIGH_MEDIAN


def huber_weights(length: Floats, bend: float) -> Floats:
    """Weights (n,) of squares that turn least squares into Huber's loss; both in standard deviations."""
    return np.minimum(1.0, bend / np.maximum(length, 1e-300))


def huber_loss(length: Floats, bend: float) -> Floats:
    """Twice Huber's loss (n,); the loss of a length up to ``bend`` is its square."""
    short = np.minimum(length, bend)
    return short * (2.0 * length - short)


@dataclass(frozen=True, slots=True, eq=False)
class _Problem:
    model: Model
    seen: Observations
    precision: Floats
    loss: Loss
    poses_only: bool

    def at(self, state: State, noise: float | None = None) -> Solution | None:
        """The objective at ``state`` for ``noise``, or for the loss's own; None where it has none."""
        prediction = self.model.predict(state, self.seen)
        return self.measured(state, prediction, noise) if prediction.valid else None

    def measured(self, state: State, prediction: Prediction, noise: float | None = None) -> Solution:
        """The objective of a valid ``prediction`` for ``noise``, or for the loss's own."""
        length = lengths(prediction.residual, self.seen.weight)
        noise = noise or self.loss.std or max(robust_scale(length), LEAST_NOISE)
        misfit = huber_loss(length / noise, self.loss.huber).sum()
        objective = 0.5 * float(misfit + self.precision @ state.globals**2)
        if self.model.motion:
            objective += 0.5 * float(((state.motions / (self.model.motion * noise)) ** 2).sum())
        return Solution(self.model, state, prediction, objective, noise)

    def step(self, here: Solution, linear: Linearisation, damping: float) -> tuple[Solution, float] | None:
        """The damped Gauss-Newton step and the gain that the linearised problem promises for it; None where it leads
        out of the model.
        """
        length = lengths(here.prediction.residual, self.seen.weight) / here.noise
        weight = self.seen.weight**2 * huber_weights(length, self.loss.huber)
        try:
            equations = eliminate(linear, here.prediction.residual, weight, self.seen, damping)
            precision = self.precision * here.noise**2
            factor = cho_factor(equations.matrix + np.diag(precision), lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return None
        right = equations.right - precision * here.state.globals
        step = np.zeros_like(right) if self.poses_only else cho_solve(factor, right, check_finite=False)
        there = self.at(here.state.moved(step, equations.pose_steps(step)), here.noise)
        promised = 0.5 * float(right @ step + (equations.pose_right**2).sum()) / here.noise**2
        return None if there is None else (there, promised)


def measured(model: Model, state: State, seen: Observations, precision: Floats, loss: Loss) -> Solution | None:
    """``state`` as a solution; None where the trend does not see all corners from there. ``precision`` (D,) is the
    prior's.
    """
    return _Problem(model, seen, precision, loss, poses_only=False).at(state)


def minimise(
    model: Model,
    state: State,
    seen: Observations,
    precision: Floats,
    loss: Loss,
    *,
    most_steps: int = 30,
    tolerance: float = 0.02,
    poses_only: bool = False,
) -> Solution | None:
    """The minimum near ``state``; None where the trend does not see all corners from there.

    ``precision`` (D,) is the prior's, ``tolerance`` the decrease of the objective (nats) that ends the
    search.
    """
    problem = _Problem(model, seen, precision, loss, poses_only)
    here = problem.at(state)
    if here is None:
        return None
    linear = None
    damping, easily = FIRST_DAMPING, True
    for _ in range(most_steps):
        linear = linear or model.linearise(here.state, seen, here.prediction)
        there, promised = problem.step(here, linear, damping) or (here, np.inf)
        gain = here.objective - there.objective
        if there is here or not gain >= 0.0:
            damping, easily = 10.0 * damping, False
            if damping > MOST_DAMPING:
                break
            continue
        here = problem.measured(there.state, there.prediction)
        # A step that brings what it promised was one of a quadratic, and leads to its end.
        if min(gain, abs(gain - promised)) < tolerance and damping <= TRUSTED_DAMPING:
            break
        damping = max(damping / (10.0 if easily else 1.0), LEAST_DAMPING)  # not at once to where it just failed
        easily, linear = True, None
    return here
