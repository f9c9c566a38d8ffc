"""The joint model: a corner is seen at x = w + g(w) + noise, where w is the trend's image of the ray through R X + t.

The noise is where it arises, in the image, so the residual x − w − g(w) is in normalised image units without any
whitening, and no map can lower it by shrinking. All unknowns but the poses are global: θ (D,) = (weights of g_u,
weights of g_v, β of the trend, η of the board's shape).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from pinholify.arrays import Bools, Floats
from pinholify.geometry import POSE_DOF
from pinholify.refinement.basis import SineBasis
from pinholify.refinement.observations import Observations
from pinholify.refinement.shape import BoardShape
from pinholify.refinement.trends import Trend


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """Values of all unknowns.

    ``weights`` (M, 2) are those of the process, ``beta`` (P,) the parameters of the trend, ``eta`` (S,) those of the
    board's shape. Each board has ``rotations`` (K, 3, 3) and, for its middle, ``translations`` (K, 3) in squares;
    ``motions`` (K, 3) are the rotation vectors by which it turns about the camera's centre while the shutter moves down
    by one normalised unit.
    """

    weights: Floats
    beta: Floats
    eta: Floats
    rotations: Floats
    translations: Floats
    motions: Floats

    @classmethod
    def still(cls, beta: Floats, eta: Floats, rotations: Floats, translations: Floats) -> State:
        """A state without process, with boards that do not move."""
        return cls(np.zeros((0, 2)), beta, eta, rotations, translations, np.zeros_like(translations))

    @property
    def globals(self) -> Floats:
        """The global unknowns θ (D,)."""
        return np.concatenate([self.weights.T.ravel(), self.beta, self.eta])

    def moved(self, step: Floats, pose_steps: Floats) -> State:
        """The state at θ + ``step`` (D,), with poses rotated and shifted by ``pose_steps`` (K, 6 or 9).

        The last 3 of 9 are steps of the motions.
        """
        m, p = self.weights.size, len(self.beta)
        return State(
            self.weights + step[:m].reshape(2, -1).T,
            self.beta + step[m : m + p],
            self.eta + step[m + p :],
            Rotation.from_rotvec(pose_steps[:, :3]).as_matrix() @ self.rotations,
            self.translations + pose_steps[:, 3:6],
            self.motions + pose_steps[:, 6:] if pose_steps.shape[1] > POSE_DOF else self.motions,
        )

    def of_boards(self, keep: Bools) -> State:
        """The same camera with only the boards where ``keep`` (K,) is True."""
        return replace(
            self,
            rotations=self.rotations[keep],
            translations=self.translations[keep],
            motions=self.motions[keep],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """The images of all corners at a state, with the intermediate results; nan for corners that the trend does not see.

    ``turned`` (N, 3) are the board's points rotated into the camera's axes, ``camera`` (N, 3) the same from the optical
    centre, ``chart`` (N, 2) the coordinates c of their rays, ``undisplaced`` (N, 2) the w, ``slope`` (N, 2, 2) =
    ∂(w + g)/∂w, ``image`` (N, 2) = w + g(w), and ``residual`` (N, 2) observed minus predicted.
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
    """Derivatives of the predicted images.

    ``basis`` (N, M) are the values of ``functions`` at ``undisplaced`` (N, 2), which are the derivatives by the weights
    of each output. ``shared`` (N, 2, P + S) are those by (β, η), ``pose`` (N, 2, 6 or 9) those by each board's pose
    and, where boards move, its motion. The prior of pose and motion has the precision ``stiffness`` (6 or 9,) in units
    of the noise's; ``moved`` (K, 6 or 9) is how far they are from its mean.
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
    """The ``trend``, the functions ``basis`` of the process, the board's ``shape``, and its ``motion``.

    ``motion`` is the prior standard deviation of the boards' motions in units of the noise, 0 where they stand still.
    """

    trend: Trend
    basis: SineBasis
    shape: BoardShape
    motion: float = 0.0

    def trend_precision(self) -> Floats:
        """Prior precision (P + S,) of (β, η)."""
        return np.asarray(np.concatenate([self.trend.prior_std, self.shape.prior_std]) ** -2.0)

    def predict(self, state: State, seen: Observations) -> Prediction:
        """The images of the corners ``seen`` at ``state``."""
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
        """The derivatives at ``state``, of which ``at`` is the prediction."""
        by_camera, by_beta = self._derivatives(state, at)
        by_still = self._by_still(by_camera, state, seen)
        by_eta = self.shape.slopes(by_still @ state.rotations[seen.view], seen)
        shared = np.concatenate([by_beta, by_eta], axis=2)
        pose = [np.cross(at.turned[:, None, :], by_still), by_still]
        stiffness, moved = np.zeros(POSE_DOF), np.zeros((seen.boards, POSE_DOF))
        if self.motion:
            still = at.turned + state.translations[seen.view]
            pose.append(seen.row[:, None, None] * np.cross(still[:, None, :], by_camera))
            stiffness, moved = np.append(stiffness, np.full(3, self.motion**-2.0)), np.hstack([moved, state.motions])
        values = self.basis.values(at.undisplaced)
        return Linearisation(
            self.basis, at.undisplaced, values, shared, np.concatenate(pose, axis=2), stiffness, moved
        )

    def by_point(self, state: State, seen: Observations, at: Prediction) -> Floats:
        """∂image/∂(point of the board, in the board's axes): (N, 2, 3)."""
        by_camera, _ = self._derivatives(state, at)
        return np.asarray(self._by_still(by_camera, state, seen) @ state.rotations[seen.view])

    def _by_still(self, by_camera: Floats, state: State, seen: Observations) -> Floats:
        """Derivatives (N, 2, 3) by a point in the camera's axes before its motion, from those after it."""
        if not self.motion:
            return by_camera
        return by_camera + seen.row[:, None, None] * np.cross(by_camera, state.motions[seen.view][:, None, :])

    def _derivatives(self, state: State, at: Prediction) -> tuple[Floats, Floats]:
        """Derivatives of the images by points in the camera's axes (N, 2, 3), and by β (N, 2, P)."""
        by_ray, by_beta = self.trend.jacobians(state.beta, at.undisplaced, at.chart)
        if len(self.basis):
            by_ray, by_beta = at.slope @ by_ray, at.slope @ by_beta
        return by_ray @ self.trend.chart.coordinate_jacobian(at.camera), by_beta
