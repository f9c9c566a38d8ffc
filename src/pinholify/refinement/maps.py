"""The map that the joint solve finds: pixels to ray angles, with the covariance of everything it rests on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pinholify.arrays import Floats, frozen
from pinholify.charts import (
    angles_to_directions,
    angles_to_directions_jacobian,
    directions_to_angles,
    directions_to_angles_jacobian,
)
from pinholify.geometry import POSE_DOF, cross_matrices, inverse_2x2
from pinholify.refinement.basis import SineBasis
from pinholify.refinement.observations import ImageFrame
from pinholify.refinement.trends import Trend

if TYPE_CHECKING:  # loads SciPy
    from pinholify.gp.maps import Nearby


MAX_PIXELS_AT_ONCE = 4096  # pixels, of which features are held in memory


@dataclass(frozen=True, slots=True, eq=False)
class JointMap:
    """q = angles of the trend's ray at w, w + g(w) = uv: a :class:`pinholify.gp.maps.PlaneMap`.

    ``frame`` normalises the image, ``beta`` (P,) are the trend's parameters, ``weights`` (M, 2) those of g in
    ``basis``. Angles are in the joint solve's own axes; the reference board's pose there is ``rotation`` (3,
    3) and ``translation`` (3,) of the board's ``middle`` (2,), in squares. ``root`` (D + 6, r) is a root of
    the joint covariance of the weights of g_u and g_v, β and (where r has it) the reference pose's turn and
    shift in the solve's axes.

    ``turn_root`` (3, r) turns the camera so that what ``root`` does to the map's rays is as small as a turn can make
    it. The covariance is of rays in the reference board's frame: it counts that this frame is only known as well
    as that board's pose. ``disagreement`` is the factor by which the roots are larger than the noise alone makes them.
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
        """q (n, 2) in radians."""
        return self._angles(self._undisplaced(uv))

    def jacobian(self, uv: Floats) -> Floats:
        """∂q/∂uv (n, 2, 2), radians per px."""
        w = self._undisplaced(uv)
        by_image, _ = self._slopes(w)
        return by_image * (self.frame.signs / self.frame.scale)

    def covariance(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2), radians²."""
        return self._covariances(uv, self._slopes_of_angles, self.root)

    def covariance_up_to_turn(self, uv: Floats) -> Floats:
        """Covariance of q (n, 2, 2) once each error of the map is turned back as well as it goes, over all corners."""
        turned = np.concatenate([self.root[:-POSE_DOF], self.turn_root, np.zeros_like(self.turn_root)])
        return self._covariances(uv, self._slopes_of_angles, turned)

    def with_turn_fitted(self, uv: Floats) -> JointMap:
        """The same map with :attr:`turn_root` fitted to its errors at pixels ``uv`` (n, 2)."""
        features = self.features(uv)
        features = features[np.isfinite(features).all(axis=(1, 2))]  # a trend may end short of a corner
        turns = features[:, :, -POSE_DOF:-3].reshape(-1, 3)
        back = np.linalg.pinv(turns) @ features[:, :, :-POSE_DOF].reshape(len(turns), -1)
        return replace(self, turn_root=-back @ self.root[:-POSE_DOF])

    def with_disagreement(self, factor: float) -> JointMap:
        """The same map where the boards disagree ``factor`` times as much as their noise explains."""
        return replace(self, root=factor * self.root, turn_root=factor * self.turn_root, disagreement=factor)

    def virtual_covariance(self, uv: Floats) -> Floats:
        """Covariance (n, 2, 2) of virtual points, squares²: what the reference board's pose and K share cancels."""
        return self._covariances(uv, self._slopes_of_virtual, self.root)

    def inverse(self, q: Floats, nearby: Nearby) -> Floats:
        """uv (n, 2) of ``q``, on the trend's own branch; nan where it has none."""
        chart = self.trend.chart
        with np.errstate(invalid="ignore"):
            c = chart.coordinates(angles_to_directions(q))
            near = self.frame.normalise(nearby(q)[0]) if self.trend.searches else c
            w = self.trend.image(self.beta, c, near)
        return self.frame.restore(w + self.basis.combined(self.weights, w))

    def noise_response(self, uv: Floats, draws: int, rng: np.random.Generator) -> Floats:
        """Shifts of q (draws, n, 2), to first order: draws of the posterior, where little is left of the
        prior.
        """
        moved = self.features(uv) @ (self.root @ rng.standard_normal((self.root.shape[1], draws)))
        return np.moveaxis(moved, 2, 0)

    # --- beyond it ---

    def features(self, uv: Floats) -> Floats:
        """∂q/∂unknowns of :attr:`root` at fixed ``uv`` (n, 2), q in the reference board's frame: (n, 2, D +
        6).
        """
        w = self._undisplaced(uv)
        return self._spread_out(w, *self._slopes_of_angles(w))

    def intrinsics_features(self) -> Floats:
        """∂(f, uc, vc)/∂unknowns of :attr:`root`, (3, D + 6)."""
        centre = self.rotation.T @ np.column_stack([cross_matrices(self.translation[None])[0], np.eye(3)])
        features = np.zeros((3, len(self.root)))
        features[:, -POSE_DOF:] = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]]) @ centre
        return features

    def virtual_features(self, uv: Floats) -> Floats:
        """∂(virtual point)/∂unknowns of :attr:`root` at fixed ``uv``, (n, 2, D + 6), squares.

        Unlike a ray's, a virtual point's error leaves out what the reference board's pose and K share.
        """
        w = self._undisplaced(uv)
        return self._spread_out(w, *self._slopes_of_virtual(w))

    def _spread_out(self, w: Floats, by_displacement: Floats, by_rest: Floats) -> Floats:
        """Derivatives (n, 2, D + 6) by all unknowns, of those by g(w) (n, 2, 2) and by all but its weights."""
        displaced = by_displacement[:, :, :, None] * self.basis.values(w)[:, None, None, :]
        return np.concatenate([displaced.reshape(len(w), 2, -1), by_rest], axis=2)

    def _slopes_of_angles(self, w: Floats) -> tuple[Floats, Floats]:
        """∂q/∂g (n, 2, 2) at fixed uv, and ∂q/∂(β, turn, shift) (n, 2, P + 6), at w."""
        by_image, by_beta = self._slopes(w)
        directions = angles_to_directions(self._angles(w))
        by_turn = directions_to_angles_jacobian(directions) @ cross_matrices(directions)
        return -by_image, np.concatenate([by_beta, by_turn, np.zeros((len(w), 2, 3))], axis=2)

    def _slopes_of_virtual(self, w: Floats) -> tuple[Floats, Floats]:
        """The same of virtual points."""
        q = self._angles(w)
        directions = angles_to_directions(q) @ self.rotation
        f = (self.rotation.T @ self.translation)[2]
        x, y, z = directions.T
        by_direction = np.zeros((len(w), 2, 3))
        by_direction[:, 0, 0] = by_direction[:, 1, 1] = f / z
        by_direction[:, 0, 2], by_direction[:, 1, 2] = -f * x / z**2, -f * y / z**2
        by_angles = by_direction @ (self.rotation.T @ angles_to_directions_jacobian(q))
        by_k = np.zeros((len(w), 2, 3))
        by_k[:, 0, 0], by_k[:, 1, 0] = x / z, y / z
        by_k[:, 0, 1] = by_k[:, 1, 2] = 1.0
        by_displacement, by_rest = self._slopes_of_angles(w)
        by_rest = by_angles @ by_rest + by_k @ self.intrinsics_features()[:, 2 * len(self.basis) :]
        return by_angles @ by_displacement, by_rest

    def _covariances(self, uv: Floats, slopes: Callable[[Floats], tuple[Floats, Floats]], root: Floats) -> Floats:
        """Covariances (n, 2, 2) at pixels ``uv`` of what has the ``slopes`` by g(w) and the unknowns beside it, where
        ``root`` is one of the unknowns' covariance.
        """
        m, unknowns = len(self.basis), root @ root.T
        u, v = slice(m), slice(m, 2 * m)
        series = self.basis.product_series(np.stack([unknowns[u, u], unknowns[u, v], unknowns[v, v]]))

        def covariances(some: Floats) -> Floats:
            w = self._undisplaced(some)
            return self._propagated(w, *slopes(w), unknowns, series)

        return _in_parts(covariances, uv)

    def _propagated(
        self, w: Floats, by_displacement: Floats, by_rest: Floats, unknowns: Floats, series: Floats
    ) -> Floats:
        """Covariances (n, 2, 2), at w, of what has these slopes, from that of the ``unknowns``; ``series`` has the sums
        of its blocks of weights.
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
        """∂q/∂x (n, 2, 2) and ∂q/∂β at fixed x (n, 2, P), at w."""
        chart, c = self.trend.chart, self.trend.ray(self.beta, w)
        by_ray, by_beta = self.trend.jacobians(self.beta, w, c)  # of w
        by_c = directions_to_angles_jacobian(chart.directions(c)) @ chart.direction_jacobian(c)
        by_w = by_c @ inverse_2x2(by_ray)
        displacement = np.eye(2) + self.basis.combine(self.weights, w)[1]
        return by_w @ inverse_2x2(displacement), -by_w @ by_beta


def _in_parts(function: Callable[[Floats], Floats], uv: Floats) -> Floats:
    """``function`` of pixels (n, 2), of so many at a time as memory holds the features of."""
    return np.concatenate([function(some) for some in np.array_split(uv, len(uv) // MAX_PIXELS_AT_ONCE + 1)])
