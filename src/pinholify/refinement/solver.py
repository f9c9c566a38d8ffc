"""Levenberg-Marquardt on the joint model with the poses eliminated, and its robust loss.

The objective is the exact one: residuals relative to the noise, plus the priors. A step that does not lower it is not
taken. The damping serves the descent alone and has no part in any evidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pinholify.arrays import Floats
from pinholify.refinement.model import Linearisation, Model, Prediction, State
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import Observations

FIRST_DAMPING, DAMPING_FACTOR = 1e-5, 10.0
MIN_DAMPING, MAX_DAMPING = 1e-9, 1e6
TRUSTED_DAMPING = 1e-2  # under a stronger damping a small gain does not indicate convergence
MIN_NOISE = 1e-9  # normalised image units
RAYLEIGH_MEDIAN = float(np.sqrt(2.0 * np.log(2.0)))  # median length of a normal residual of unit std per axis


@dataclass(frozen=True, slots=True)
class Loss:
    """The noise ``std`` per axis (normalised), and the length at which Huber's loss turns linear, in units of it.

    If ``std`` is None, it is the robust scale of the residuals at each step.
    """

    std: float | None = None
    huber: float = np.inf


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """A point of a descent: the model, its state, the prediction there, the objective (nats) and the noise in it."""

    model: Model
    state: State
    prediction: Prediction
    objective: float
    noise: float


def lengths(residual: Floats, weight: Floats) -> Floats:
    """Lengths (n,) of ``residual`` (n, 2), each times its corner's ``weight`` (n,)."""
    return np.asarray(np.linalg.norm(residual, axis=1) * weight)


def robust_scale(length: Floats) -> float:
    """The standard deviation per axis of residuals of the given lengths (n,), by their median."""
    return float(np.median(length)) / RAYLEIGH_MEDIAN


def huber_weights(length: Floats, bend: float) -> Floats:
    """Weights (n,) of squares that turn least squares into Huber's loss; arguments in standard deviations."""
    return np.minimum(1.0, bend / np.maximum(length, 1e-300))


def huber_loss(length: Floats, bend: float) -> Floats:
    """Twice Huber's loss (n,): the square of a length up to ``bend``, and linear beyond it."""
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
        """The objective at ``state`` for ``noise``, by default the loss's; None where the trend misses a corner."""
        prediction = self.model.predict(state, self.seen)
        return self.measured(state, prediction, noise) if prediction.valid else None

    def measured(self, state: State, prediction: Prediction, noise: float | None = None) -> Solution:
        """The objective of a valid ``prediction`` for ``noise``, by default the loss's."""
        length = lengths(prediction.residual, self.seen.weight)
        noise = noise or self.loss.std or max(robust_scale(length), MIN_NOISE)
        misfit = huber_loss(length / noise, self.loss.huber).sum()
        objective = 0.5 * float(misfit + self.precision @ state.globals**2)
        if self.model.motion:
            objective += 0.5 * float(((state.motions / (self.model.motion * noise)) ** 2).sum())
        return Solution(self.model, state, prediction, objective, noise)

    def step(self, here: Solution, linear: Linearisation, damping: float) -> tuple[Solution, float] | None:
        """The solution after the damped Gauss-Newton step, and the gain that the linearised problem promises for it.

        None where the equations are singular or the trend does not see all corners after the step.
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
    """``state`` as a solution; None where the trend does not see all corners there.

    ``precision`` (D,) is the prior's.
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
    """The minimum near ``state``; None where the trend does not see all corners there.

    ``precision`` (D,) is the prior's; a decrease of the objective below ``tolerance`` (nats) ends the descent. With
    ``poses_only`` the globals stay fixed.
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
            damping, easily = DAMPING_FACTOR * damping, False
            if damping > MAX_DAMPING:
                break
            continue
        here = problem.measured(there.state, there.prediction)
        # A step that gains what was promised was one on a quadratic, and ends at its minimum.
        if min(gain, abs(gain - promised)) < tolerance and damping <= TRUSTED_DAMPING:
            break
        damping = max(damping / (DAMPING_FACTOR if easily else 1.0), MIN_DAMPING)  # not at once to what just failed
        easily, linear = True, None
    return here
