"""The map found by the joint solve: pixels to ray angles, with the joint covariance of all its unknowns.

A pixel maps to a ray by inverting the displacement, uv → w, and the trend, w → ray. Its error is the derivative of that
by all unknowns times a root of their covariance; uncertainties of rays, of virtual points, and of both up to a rotation
of the camera differ only in that derivative.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Floats, frozen
from pinholify.charts import (
    angles_to_directions,
    directions_to_angles,
    directions_to_angles_jacobian,
)
from pinholify.geometry import POSE_DOF, cross_matrices, inverse_2x2
from pinholify.refinement.basis import SineBasis
from pinholify.refinement.observations import ImageFrame
from pinholify.refinement.trends import Trend

if TYPE_CHECKING:  # loads SciPy
    from pinholify.gp.maps import Nearby

MAX_PIXELS_AT_ONCE = 4096  # whose derivatives are held in memory


@dataclass(frozen=True, slots=True, eq=False)
class JointMap:
    """The map q = angles of the trend's ray at w, where w + g(w) = uv: a :class:`pinholify.gp.maps.PlaneMap`.

    ``frame`` normalises the image, ``beta`` (P,) are the trend's parameters, ``weights`` (M, 2) those of g in
    ``basis``. Angles are in the joint solve's own axes. The reference board's pose there is ``rotation`` (3, 3) and
    ``translation`` (3,) of the board's ``middle`` (2,), in squares. ``root`` (D + 6, r) is a root of the joint
    covariance of the weights of g_u and of g_v, of β, and of the rotation and translation of the reference pose in the
    solve's axes.

    The covariance is that of rays in the reference board's frame, so it includes the uncertainty of that board's pose.
    ``turn_root`` (3, r) are rotations of the camera that, added to the errors of ``root``, make the rays' errors as
    small as rotations can. ``disagreement`` is the factor by which both roots exceed those due to noise alone.
    """

    frame: ImageFrame
    trend: Trend
    beta: Floats
    basis: SineBasis
    weights: Floats
    rotation: Floats
    translation: Floats
    middle: Floats
    root: Floats
    turn_root: Floats
    disagreement: float = 1.0

    def __post_init__(self) -> None:
        unknowns = 2 * len(self.basis) + len(self.beta) + POSE_DOF
        shapes: dict[str, tuple[int | None, ...]] = {
            "beta": (None,),
            "weights": (len(self.basis), 2),
            "rotation": (3, 3),
            "translation": (3,),
            "middle": (2,),
            "root": (unknowns, None),
            "turn_root": (3, None),
        }
        for name, shape in shapes.items():
            object.__setattr__(self, name, frozen(getattr(self, name), shape))

    # --- a PlaneMap ---

    def value(self, uv: Floats) -> Floats:
        """Ray angles q (n, 2) in radians at pixels ``uv`` (n, 2)."""
        return self._angles(self._undisplaced(uv))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2), radians per px, at pixels ``uv`` (n, 2)."""
        w = self._undisplaced(uv)
        by_image, _ = self._slopes(w)
        return by_image * (self.frame.signs / self.frame.scale)

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2), radians², at pixels ``uv`` (n, 2)."""
        return self._covariances(uv, self._slopes_of_angles, self.root)

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2), radians², without what the best rotation of the camera absorbs."""
        turned = np.concatenate([self.root[:-POSE_DOF], self.turn_root, np.zeros_like(self.turn_root)])
        return self._covariances(uv, self._slopes_of_angles, turned)

    def with_turn_fitted(self, uv: Floats) -> JointMap:
        """The same map with :attr:`turn_root` fitted to its errors at pixels ``uv`` (n, 2)."""
        features = self.features(uv)
        features = features[np.isfinite(features).all(axis=(1, 2))]  # the trend may have no ray at a corner
        turns = features[:, :, -POSE_DOF:-3].reshape(-1, 3)
        back = np.linalg.pinv(turns) @ features[:, :, :-POSE_DOF].reshape(len(turns), -1)
        return replace(self, turn_root=-back @ self.root[:-POSE_DOF])

    def with_disagreement(self, factor: float) -> JointMap:
        """The same map with errors ``factor`` times as large, for boards that disagree more than noise explains."""
        return replace(self, root=factor * self.root, turn_root=factor * self.turn_root, disagreement=factor)

    def virtual_covariance(self, uv: Floats, by_q: Floats, by_k: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points, squares²: errors that the reference pose and K share cancel.

        ``by_q`` (n, 2, 2) and ``by_k`` (n, 2, 3) are their derivatives by q and by K.
        """
        k_by_rest = self.intrinsics_features()[:, 2 * len(self.basis) :]

        def slopes(w: Floats, by_q: Floats, by_k: Floats) -> tuple[Floats, Floats]:
            by_displacement, by_rest = self._slopes_of_angles(w)
            return by_q @ by_displacement, by_q @ by_rest + by_k @ k_by_rest

        return self._covariances(uv, slopes, self.root, by_q, by_k)

    def covariance_root(self, uv: Floats) -> Floats:
        """A root (n, 2, r) of the covariance of all q together, radians."""
        return np.asarray(self.features(uv) @ self.root)

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """Pixels uv (n, 2) of angles ``q`` (n, 2), on the trend's own branch; nan where it has none."""
        chart = self.trend.chart
        with np.errstate(invalid="ignore"):
            c = chart.coordinates(angles_to_directions(q))
            near = self.frame.normalise(nearby(q)[0]) if self.trend.inverse_is_iterative else c
            w = self.trend.image(self.beta, c, near)
        return self.frame.restore(w + self.basis.combined(self.weights, w))

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Changes of q (draws, n, 2) for new noise, to first order: draws of the posterior, which noise dominates."""
        moved = self.features(uv) @ (self.root @ rng.standard_normal((self.root.shape[1], draws)))
        return np.moveaxis(moved, 2, 0)

    # --- beyond it ---

    def features(self, uv: Floats) -> Floats:
        """∂q/∂(unknowns of :attr:`root`) (n, 2, D + 6) at fixed ``uv`` (n, 2), q in the reference board's frame."""
        w = self._undisplaced(uv)
        by_displacement, by_rest = self._slopes_of_angles(w)
        displaced = by_displacement[:, :, :, None] * self.basis.values(w)[:, None, None, :]
        return np.concatenate([displaced.reshape(len(w), 2, -1), by_rest], axis=2)

    def intrinsics_features(self) -> Floats:
        """∂(f, uc, vc)/∂(unknowns of :attr:`root`) (3, D + 6), in squares."""
        centre = self.rotation.T @ np.column_stack([cross_matrices(self.translation[None])[0], np.eye(3)])
        features = np.zeros((3, len(self.root)))
        features[:, -POSE_DOF:] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]) @ centre
        return features

    def _slopes_of_angles(self, w: Floats) -> tuple[Floats, Floats]:
        """∂q/∂g (n, 2, 2) and ∂q/∂(β, rotation, translation) (n, 2, P + 6) at fixed uv, at ``w`` (n, 2)."""
        by_image, by_beta = self._slopes(w)
        directions = angles_to_directions(self._angles(w))
        by_turn = directions_to_angles_jacobian(directions) @ cross_matrices(directions)
        return -by_image, np.concatenate([by_beta, by_turn, np.zeros((len(w), 2, 3))], axis=2)

    def _covariances(
        self, uv: Floats, slopes: Callable[..., tuple[Floats, Floats]], root: Floats, *given: Floats
    ) -> Floats:
        """Covariances (n, 2, 2) at pixels ``uv`` (n, 2) of a function of the unknowns, given its derivatives.

        ``slopes`` of w and of what is ``given`` (n, …) for each pixel are those by g(w) and by the unknowns that are
        not weights; ``root`` is that of their covariance.
        """
        m, unknowns = len(self.basis), root @ root.T
        u, v = slice(m), slice(m, 2 * m)
        series = self.basis.product_series(np.stack([unknowns[u, u], unknowns[u, v], unknowns[v, v]]))

        def covariances(some: Floats, *given: Floats) -> Floats:
            w = self._undisplaced(some)
            return self._propagated(w, *slopes(w, *given), unknowns, series)

        return _in_parts(covariances, uv, *given)

    def _propagated(
        self, w: Floats, by_displacement: Floats, by_rest: Floats, unknowns: Floats, series: Floats
    ) -> Floats:
        """Covariances (n, 2, 2) at ``w`` (n, 2) from the covariance of the ``unknowns`` and the derivatives.

        ``series`` are the cosine series of the blocks of the weights' covariance.
        """
        m = len(self.basis)
        rest = unknowns[2 * m :, 2 * m :]
        own = np.asarray(by_rest @ rest @ by_rest.transpose(0, 2, 1))
        if not m:
            return own
        mixed = [self.basis.combined(unknowns[axis : axis + m, 2 * m :], w) for axis in (0, m)]
        of_g = self.basis.summed(series, w)[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        half = np.stack(mixed, axis=1) @ by_rest.transpose(0, 2, 1) + 0.5 * of_g @ by_displacement.transpose(0, 2, 1)
        half = by_displacement @ half
        return own + half + half.transpose(0, 2, 1)

    def _undisplaced(self, uv: Floats) -> Floats:
        return self.basis.undisplaced(self.weights, self.frame.normalise(uv))

    def _angles(self, w: Floats) -> Floats:
        chart = self.trend.chart
        return directions_to_angles(chart.directions(self.trend.ray(self.beta, w)))

    def _slopes(self, w: Floats) -> tuple[Floats, Floats]:
        """∂q/∂x (n, 2, 2) and ∂q/∂β (n, 2, P) at fixed x, at ``w`` (n, 2)."""
        chart, c = self.trend.chart, self.trend.ray(self.beta, w)
        by_ray, by_beta = self.trend.jacobians(self.beta, w, c)  # of w
        by_c = directions_to_angles_jacobian(chart.directions(c)) @ chart.direction_jacobian(c)
        by_w = by_c @ inverse_2x2(by_ray)
        displacement = np.eye(2) + self.basis.combine(self.weights, w)[1]
        return by_w @ inverse_2x2(displacement), -by_w @ by_beta


def _in_parts(function: Callable[..., Floats], *given: Floats) -> Floats:
    """``function`` of arrays (n, …), with a row for each pixel, computed in parts to limit memory."""
    count = len(given[0]) // MAX_PIXELS_AT_ONCE + 1
    return np.concatenate([function(*some) for some in zip(*(np.array_split(a, count) for a in given), strict=True)])
