"""The joint model: a corner is seen at x = w + g(w) + noise, w = trend of the ray through R X + t.

The noise stands where it is, in the image, so the residual x − w − g(w) is in px (normalised) without any
whitening, and no map can lower it by stretching. All unknowns but the poses are global: θ = (weights of g_u,
weights of g_v, β, η).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pinholify.arrays import Bools, Floats
from pinholify.geometry import rotations_of
from pinholify.refinement.basis import SineBasis
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.trends import Trend

POSE = 6


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A point in the space of unknowns.

    ``weights`` (M, 2) of the process, ``beta`` (P,) of the trend, ``eta`` of the board's shape, and for each
    board ``rotations`` (K, 3, 3) and ``translations`` (K, 3) of its middle, in squares, and its ``motions`` (K, 3), the
    turn about the camera's centre, as a rotation vector, from one row to another that lies a unit below.
    """

    weights: Floats
    beta: Floats
    eta: Floats
    rotations: Floats
    translations: Floats
    motions: Floats

    @classmethod
    def still(cls, beta: Floats, eta: Floats, rotations: Floats, translations: Floats) -> State:
        """A state without process, whose boards do not move."""
        return cls(np.zeros((0, 2)), beta, eta, rotations, translations, np.zeros_like(translations))

    @property
    def globals(self) -> Floats:
        """θ (D,)."""
        return np.concatenate([self.weights.T.ravel(), self.beta, self.eta])

    def moved(self, step: Floats, pose_steps: Floats) -> State:
        """θ + ``step`` (D,), each pose turned and shifted by ``pose_steps`` (K, 6 or 9), the last 3 its motion's."""
        m, p = self.weights.size, len(self.beta)
        return State(
            self.weights + step[:m].reshape(2, -1).T,
            self.beta + step[m : m + p],
            self.eta + step[m + p :],
            rotations_of(pose_steps[:, :3]) @ self.rotations,
            self.translations + pose_steps[:, 3:6],
            self.motions + pose_steps[:, 6:] if pose_steps.shape[1] > POSE else self.motions,
        )

    def of_boards(self, keep: Bools) -> State:
        """The same camera with the boards where ``keep`` (K,) is true."""
        return replace(
            self,
            rotations=self.rotations[keep],
            translations=self.translations[keep],
            motions=self.motions[keep],
        )


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
    ``shared`` (N, 2, P) by (β, η), ``pose`` (N, 2, 6 or 9) by each board's pose and, where boards move, its motion.

    The prior of pose and motion has the precision ``stiffness`` (6 or 9,) in units of the noise's; ``moved`` (K, 6 or
    9) is how far they are from its mean.
    """

    functions: SineBasis
    undisplaced: Floats
    basis: Floats
    shared: Floats
    pose: Floats
    stiffness: Floats
    moved: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """The trend, the functions of the process, the board's shape, and how much boards move while the shutter rolls:
    ``motion`` is the standard deviation of motions in units of the noise, 0 where they stand still.
    """

    trend: Trend
    basis: SineBasis
    shape: BoardShape
    motion: float = 0.0

    def trend_precision(self) -> Floats:
        """Prior precision of (β, η)."""
        return np.asarray(np.concatenate([self.trend.prior_std, self.shape.prior_std]) ** -2.0)

    def predict(self, state: State, seen: Observations) -> Prediction:
        """Where ``state`` sees each corner."""
        points = self.shape.seen_points(state.eta, seen)
        turned = np.concatenate([points[k] @ r.T for k, r in zip(seen.slices(), state.rotations, strict=True)])
        camera = turned + state.translations[seen.view]
        if self.motion:
            camera = camera + seen.row[:, None] * np.cross(state.motions[seen.view], camera)
        chart = self.trend.chart.coordinates(camera)
        w = self.trend.image(state.beta, chart, seen.image)
        if not len(self.basis):
            return Prediction(turned, camera, chart, w, np.broadcast_to(np.eye(2), (len(w), 2, 2)), w, seen.image - w)
        g, gradient = self.basis.combine(state.weights, w)
        return Prediction(turned, camera, chart, w, np.eye(2) + gradient, w + g, seen.image - w - g)

    def linearise(self, state: State, seen: Observations, at: Prediction) -> Linearisation:
        """The derivatives of the prediction ``at`` ``state``."""
        by_camera, by_beta = self._derivatives(state, at)
        by_still = self._by_still(by_camera, state, seen)
        by_eta = self.shape.slopes(by_still @ state.rotations[seen.view], seen)
        shared = np.concatenate([by_beta, by_eta], axis=2)
        pose = [np.cross(at.turned[:, None, :], by_still), by_still]
        stiffness, moved = np.zeros(POSE), np.zeros((seen.boards, POSE))
        if self.motion:
            still = at.turned + state.translations[seen.view]
            pose.append(seen.row[:, None, None] * np.cross(still[:, None, :], by_camera))
            stiffness, moved = np.append(stiffness, np.full(3, self.motion**-2.0)), np.hstack([moved, state.motions])
        values = self.basis.values(at.undisplaced)
        return Linearisation(
            self.basis, at.undisplaced, values, shared, np.concatenate(pose, axis=2), stiffness, moved
        )

    def by_point(self, state: State, seen: Observations, at: Prediction) -> Floats:
        """∂ prediction/∂(points of the board, in its own axes): (N, 2, 3)."""
        by_camera, _ = self._derivatives(state, at)
        return np.asarray(self._by_still(by_camera, state, seen) @ state.rotations[seen.view])

    def _by_still(self, by_camera: Floats, state: State, seen: Observations) -> Floats:
        """By where a point is in the camera's axes before its board's motion: (N, 2, 3)."""
        if not self.motion:
            return by_camera
        return by_camera + seen.row[:, None, None] * np.cross(by_camera, state.motions[seen.view][:, None, :])

    def _derivatives(self, state: State, at: Prediction) -> tuple[Floats, Floats]:
        """By points in the camera's axes (N, 2, 3), and by β (N, 2, P)."""
        by_ray, by_beta = self.trend.jacobians(state.beta, at.undisplaced, at.chart)
        if len(self.basis):
            by_ray, by_beta = at.slope @ by_ray, at.slope @ by_beta
        return by_ray @ self.trend.chart.coordinate_jacobian(at.camera), by_beta
