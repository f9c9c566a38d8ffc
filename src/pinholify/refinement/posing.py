"""Poses of boards for a camera that is known: in closed form, and out of wrong minima."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.calibration.poses import poses_of_directions
from pinholify.refinement.model import Model, State
from pinholify.refinement.observations import Observations
from pinholify.refinement.solver import Loss, lengths, minimise, robust_scale

DOUBTFUL_RATIO = 3.0  # of a board's residuals to those of the typical board: beyond it other poses are tried
BETTER_RATIO = 1.5  # of two poses' residuals: with less the present one stays
HUBER = 3.0  # standard deviations


def reposed(model: Model, camera: State, seen: Observations) -> State:
    """``camera`` with the poses of all boards of ``seen``, by the direct linear transform of their corners' rays."""
    w = model.basis.undisplaced(camera.weights, seen.image)
    directions = model.trend.chart.directions(model.trend.ray(camera.beta, w))
    directions[~np.isfinite(directions).all(axis=1)] = [0.0, 0.0, 1.0]
    rotations, translations = poses_of_directions(directions, seen.lattice, seen.starts)
    return replace(camera, rotations=rotations, translations=translations, motions=np.zeros_like(translations))


def righted(model: Model, state: State, seen: Observations, precision: Floats) -> State:
    """``state`` with every board that fits much worse than the typical one in the best of several poses.

    A descent can end in a pose that is not the best one: with the tilt reversed, where perspective is weak, or where
    wrong corners led it. ``precision`` (D,) is the prior's. The same object is returned where no board is improved.
    """
    misfit = _misfits(model, state, seen)
    noise = float(np.median(misfit))
    loss, found = Loss(noise, HUBER), state
    for k in np.flatnonzero(misfit > DOUBTFUL_RATIO * noise):
        only = np.arange(seen.boards) == k
        own, some = state.of_boards(only), seen.select(seen.view == k)
        linear = reposed(model, own, some)
        for start in (linear, _reversed(linear), _reversed(own)):
            posed = minimise(model, start, some, precision, loss, poses_only=True)
            if posed is None or (reached := float(_misfits(model, posed.state, some)[0])) > misfit[k] / BETTER_RATIO:
                continue
            misfit[k] = reached
            found = _with_poses(found, only, posed.state)
    return found


def _misfits(model: Model, state: State, seen: Observations) -> Floats:
    """The robust scale (K,) of the residuals of each board; inf where the trend misses a corner."""
    length = lengths(model.predict(state, seen).residual, seen.weight)
    return np.nan_to_num([robust_scale(length[rows]) for rows in seen.slices()], nan=np.inf)


def _with_poses(state: State, which: Bools, posed: State) -> State:
    """``state`` with the poses of ``posed`` for the boards ``which`` (K,)."""
    poses = {name: np.array(getattr(state, name)) for name in ("rotations", "translations", "motions")}
    for name, values in poses.items():
        values[which] = getattr(posed, name)
    return replace(state, **poses)


def _reversed(state: State) -> State:
    """``state`` with the tilt of each board against the line of sight to its middle reversed.

    Under weak perspective the image of a board is nearly the same.
    """
    distance = np.linalg.norm(state.translations, axis=1, keepdims=True)
    sight = state.translations / np.maximum(distance, 1e-300)
    mirror = np.eye(3) - 2.0 * sight[:, :, None] * sight[:, None, :]
    return replace(state, rotations=mirror @ state.rotations @ np.diag([1.0, 1.0, -1.0]))
