"""The joint model: a corner is seen at x = w + g(w) + noise, w = trend of the ray through R X + t.

The noise stands where it is, in the image, so the residual x − w − g(w) is in px (normalised) without any
whitening, and no map can lower it by stretching. All unknowns but the poses are global: θ = (weights of g_u,
weights of g_v, β, η).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.refinement.basis import SineBasis
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.trends import Trend


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A point in the space of unknowns.

    ``weights`` (M, 2) of the process, ``beta`` (P,) of the trend, ``eta`` of the board's shape, and for each
    board ``rotations`` (K, 3, 3) and ``translations`` (K, 3) of its middle, in squares.
    """

    weights: Floats
    beta: Floats
    eta: Floats
    rotations: Floats
    translations: Floats

    @property
    def globals(self) -> Floats:
        """θ (D,)."""
        return np.concatenate([self.weights.T.ravel(), self.beta, self.eta])

    def moved(self, step: Floats, pose_steps: Floats) -> State:
        """θ + ``step`` (D,), and each pose turned and shifted by ``pose_steps`` (K, 6)."""
        m, p = self.weights.size, len(self.beta)
        return State(
            self.weights + step[:m].reshape(2, -1).T,
            self.beta + step[m : m + p],
            self.eta + step[m + p :],
            rotations_of(pose_steps[:, :3]) @ self.rotations,
            self.translations + pose_steps[:, 3:],
        )

    def of_boards(self, keep: Bools) -> State:
        """The same camera with the boards where ``keep`` (K,) is true."""
        return replace(self, rotations=self.rotations[keep], translations=self.translations[keep])


def rotations_of(vectors: Floats) -> Floats:
    """Rotations (n, 3, 3) by rotation vectors (n, 3) (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    cross = cross_matrices(vectors)
    half = np.sinc(angle / (2.0 * np.pi))
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * half**2 * (cross @ cross))


def cross_matrices(vectors: Floats) -> Floats:
    """[v]× (n, 3, 3) of vectors (n, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """What a state says: ``turned`` (N, 3) board points in the camera's axes, ``camera`` (N, 3) the same from
    the optical centre, ``chart`` (N, 2), ``undisplaced`` w (N, 2), ``slope`` (N, 2, 2) = ∂(w + g)/∂w,
    ``image`` w + g (N, 2), ``residual`` (N, 2). Corners that the trend cannot see are nan.
    """

    turned: Floats
    camera: Floats
    chart: Floats
    undisplaced: Floats
    slope: Floats
    image: Floats
    residual: Floats

    @property
    def valid(self) -> bool:
        """Whether the trend sees every corner."""
        return bool(np.isfinite(self.residual).all())


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """∂ prediction: φ (N, M) of ``functions`` at ``undisplaced`` (N, 2) as ``basis`` for each output's own weights,
    ``shared`` (N, 2, P) by (β, η), ``pose`` (N, 2, 6).
    """

    functions: SineBasis
    undisplaced: Floats
    basis: Floats
    shared: Floats
    pose: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The trend, the functions of the process, and the board's shape."""

    trend: Trend
    basis: SineBasis
    shape: BoardShape

    def trend_precision(self) -> Floats:
        """Prior precision of (β, η)."""
        return np.asarray(np.concatenate([self.trend.prior_std, self.shape.prior_std]) ** -2.0)

    def predict(self, state: State, seen: Observations) -> Prediction:
        """Where ``state`` sees each corner."""
        points = self.shape.points(state.eta, seen.lattice)
        turned = np.concatenate([points[k] @ r.T for k, r in zip(seen.slices(), state.rotations, strict=True)])
        camera = turned + state.translations[seen.view]
        chart = self.trend.chart.coordinates(camera)
        w = self.trend.image(state.beta, chart, seen.image)
        if not len(self.basis):
            return Prediction(turned, camera, chart, w, np.broadcast_to(np.eye(2), (len(w), 2, 2)), w, seen.image - w)
        g, gradient = self.basis.combine(state.weights, w)
        return Prediction(turned, camera, chart, w, np.eye(2) + gradient, w + g, seen.image - w - g)

    def linearise(self, state: State, seen: Observations, at: Prediction) -> Linearisation:
        """The derivatives of the prediction ``at`` ``state``."""
        by_ray, by_beta = self.trend.jacobians(state.beta, at.undisplaced, at.chart)
        if len(self.basis):
            by_ray, by_beta = at.slope @ by_ray, at.slope @ by_beta
        by_camera = by_ray @ self.trend.chart.coordinate_jacobian(at.camera)
        by_eta = self.shape.slopes(by_camera @ state.rotations[seen.view], seen.lattice)
        shared = np.concatenate([by_beta, by_eta], axis=2)
        by_turn = np.cross(at.turned[:, None, :], by_camera)
        pose = np.concatenate([by_turn, by_camera], axis=2)
        return Linearisation(self.basis, at.undisplaced, self.basis.values(at.undisplaced), shared, pose)
