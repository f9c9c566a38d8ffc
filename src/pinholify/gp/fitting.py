"""Maps of the plane fitted to point pairs; unless it is named, the trend is chosen by marginal likelihood.

Each trend is fitted by Gauss-Newton steps of its parameters, which a GP's linear part gives, and the hyperparameters
are refitted after each step.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial import cKDTree

from pinholify.arrays import Floats
from pinholify.errors import CalibrationError
from pinholify.gp.hyperparameters import SearchRange, Start, maximise_likelihood
from pinholify.gp.kernels import Kernel, kernel_named
from pinholify.gp.maps import AdditiveMap, DisplacementMap, PlaneMap, Scaling, scaling_of, trend_features
from pinholify.gp.regression import Data, GaussianProcess, LinearPart, data
from pinholify.gp.trends import Trend, trends_named
from pinholify.gp.trends.base import inverse

FEWEST_POINTS = 4
LINE_TOLERANCE = 1e-9  # width of points that lie on a line, relative to their length
MAX_ROUNDS = 12
RELATIVE_TOLERANCE = 1e-3  # a step of the trend that moves no point farther than this part of the noise is the last
SHORTEST_LENGTH_SCALE = 4.0  # of the prior, in typical distances between neighbouring points
LARGEST_SIGNAL_STD = 0.01  # of the prior, of the inputs' extent: a trend leaves little to the GP
TOLERATED_LOSS = 0.1  # nats: linearisation changes the evidence slightly even at its maximum
PRIOR_NOISE = 1e-3  # of the inputs' extent, for the least-squares start alone


@dataclass(frozen=True, slots=True, eq=False)
class FittedMap:
    """A map with the results of its fit.

    ``noise`` is the standard deviation of the points' positions per axis, in units of the inputs (px).
    ``log_evidence`` is the log marginal likelihood of the positions as a density per squared px, comparable between
    trends and kernels. ``candidates`` are all trends that were fitted, with their log evidence.
    """

    map: PlaneMap
    kernel: str
    trend: str
    noise: float
    log_evidence: float
    candidates: tuple[tuple[str, float], ...] = ()


def fit_map(
    uv: Floats, xy: Floats, *, kernel: str = "se", trend: str = "auto", relative_noise: Floats | None = None
) -> FittedMap:
    """The map from ``uv`` (n, 2) px to ``xy`` (n, 2), by a trend and a GP.

    ``kernel`` and ``trend`` are names of the registries; ``trend`` may also be ``constant`` (the paper's) or ``auto``.
    ``relative_noise`` (n,) scales the noise of each point. Raises InputError for unknown names and CalibrationError
    where nothing fits, or where the points do not span a plane.
    """
    if len(uv) < FEWEST_POINTS or not (_span_a_plane(uv) and _span_a_plane(xy)):
        raise CalibrationError(
            f"the {len(uv)} points given do not determine a map, which needs {FEWEST_POINTS} or more, all finite and "
            "not on one line: give more of the board"
        )
    scale = np.ones(len(uv)) if relative_noise is None else relative_noise
    build = kernel_named(kernel)
    fits = []
    if trend in ("constant", "auto"):
        fits.extend(_fit_constant(uv, xy, build, kernel, scale))
    if trend != "constant":
        fits.extend(_fit_trends(uv, xy, build, kernel, trends_named(trend), scale))
    if not fits:
        raise CalibrationError(
            f"no map of trend '{trend}' fits the {len(uv)} corners of the reference board: "
            "look for wrongly numbered corners, or choose another reference"
        )
    best = max(fits, key=lambda fit: fit.log_evidence)
    tried = tuple((fit.trend, fit.log_evidence) for fit in fits)
    return FittedMap(best.map, best.kernel, best.trend, best.noise, best.log_evidence, tried)


def _span_a_plane(points: Floats) -> bool:
    """Whether ``points`` (n, 2) are finite and not all on one line."""
    if not np.isfinite(points).all():
        return False
    long, wide = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(wide > LINE_TOLERANCE * long)


# --- the paper's: constant mean, two independent GPs ------------------------------------------------------------


def _fit_constant(uv: Floats, xy: Floats, kernel: Kernel, name: str, relative_noise: Floats) -> list[FittedMap]:
    """The fitted map in a list, empty where the map is singular at a point because it merely memorises the points."""
    inputs, outputs = scaling_of(uv), scaling_of(xy)
    x, y = inputs.normalise(uv), outputs.normalise(xy)
    mean = y.mean(axis=0)
    starts = [Start(std, length, 1e-3) for std, length in ((0.7, 0.7), (2.0, 1.5), (10.0, 3.0))]
    gps = [
        maximise_likelihood(kernel, data(x, column[:, None], relative_noise=relative_noise), starts=starts)
        for column in (y - mean).T
    ]
    fitted = AdditiveMap(inputs, outputs, mean, (gps[0], gps[1]))
    jacobian = fitted.jacobian(uv)
    determinant = np.abs(np.linalg.det(jacobian))
    if not (determinant > 0.0).all():
        return []
    # The likelihood is a density of xy; per squared px of uv it is larger by the map's determinant.
    density = np.log(determinant).sum() - 2 * len(uv) * np.log(outputs.scale)
    evidence = sum(gp.log_marginal_likelihood for gp in gps) + float(density)
    return [FittedMap(fitted, name, "constant", _noise_in_inputs(jacobian, gps, outputs), evidence)]


def _noise_in_inputs(jacobian: Floats, gps: list[GaussianProcess], outputs: Scaling) -> float:
    stds = np.array([gp.noise_std for gp in gps]) * outputs.scale
    return float(np.sqrt(((np.linalg.inv(jacobian) * stds) ** 2).sum(axis=(1, 2)).mean() / 2))


# --- a trend, and a GP that displaces its predictions -----------------------------------------------------------


def _fit_trends(
    uv: Floats, xy: Floats, kernel: Kernel, name: str, trends: Iterable[Trend], relative_noise: Floats
) -> list[FittedMap]:
    inputs, outputs = scaling_of(uv), scaling_of(xy)
    x, y = inputs.normalise(uv), outputs.normalise(xy)
    fits = []
    for trend in trends:
        if len(trend.prior_mean) >= 2 * len(x):
            continue
        result = _fit_displacement(trend, kernel, x, y, relative_noise)
        if result is None:
            continue
        beta, gp = result
        evidence = gp.log_marginal_likelihood - 2 * len(x) * float(np.log(inputs.scale))
        fitted = DisplacementMap(inputs, outputs, trend, beta, gp)
        fits.append(FittedMap(fitted, name, trend.name, gp.noise_std * inputs.scale, evidence))
    return fits


def _fit_displacement(
    trend: Trend, kernel: Kernel, x: Floats, y: Floats, relative_noise: Floats
) -> tuple[Floats, GaussianProcess] | None:
    """Gauss-Newton on the trend's parameters, with hyperparameters of maximum likelihood; None if h has no inverse."""
    beta = _least_squares_trend(trend, x, y)
    observed = _linearised(trend, beta, x, y, relative_noise)
    if observed is None:
        return None
    spread = float(np.sqrt((observed.y**2).mean()))
    starts = [Start(max(spread, 1e-6), length, max(spread, 1e-6) / 3) for length in (0.2, 0.6, 1.5)]
    search = SearchRange(
        std=(1e-7, 10.0),
        length_scale=(0.02, 20.0),
        noise_std=(1e-8, 1.0),
        shortest=SHORTEST_LENGTH_SCALE * _spacing(x),
        largest=LARGEST_SIGNAL_STD,
    )
    gp = maximise_likelihood(kernel, observed, starts=starts, search=search)
    for _ in range(MAX_ROUNDS):
        if np.abs(observed.linear.features @ gp.coefficients).max() < RELATIVE_TOLERANCE * gp.noise_std:
            break
        moved = _step(trend, beta, gp, search, Points(x, y, relative_noise))
        if moved is None:
            break
        beta, observed, gp = moved
    return beta, gp.with_coefficients_zero(observed)


@dataclass(frozen=True, slots=True, eq=False)
class Points:
    """Normalised point pairs and their relative noise."""

    x: Floats
    y: Floats
    relative_noise: Floats


def _step(
    trend: Trend, beta: Floats, gp: GaussianProcess, search: SearchRange, points: Points
) -> tuple[Floats, Data, GaussianProcess] | None:
    """The longest of the successively halved Gauss-Newton steps that keeps the evidence; None where none does."""
    start = Start(gp.kernel.std, float(gp.kernel.length_scale.mean()), gp.noise_std)
    for fraction in (1.0, 0.5, 0.25, 0.125):
        trial = beta + fraction * gp.coefficients
        observed = _linearised(trend, trial, points.x, points.y, points.relative_noise)
        if observed is None:
            continue
        moved = maximise_likelihood(gp.kernel, observed, starts=[start], search=search)
        if moved.log_marginal_likelihood > gp.log_marginal_likelihood - TOLERATED_LOSS:
            return trial, observed, moved
    return None


def _spacing(x: Floats) -> float:
    """Median distance between nearest neighbours."""
    return float(np.median(cKDTree(x).query(x, k=2)[0][:, 1]))


def _linearised(trend: Trend, beta: Floats, x: Floats, y: Floats, relative_noise: Floats) -> Data | None:
    """Targets x − w at w = h⁻¹(y), and the linear part of the trend's parameters around ``beta``."""
    w, reached = inverse(trend, beta, y, x)
    if not reached.all() or np.abs(w - x).max() > 0.5:
        return None
    linear = LinearPart(trend_features(trend, beta, w), trend.prior_mean - beta, trend.prior_std)
    return data(w, x - w, linear, relative_noise)


def _least_squares_trend(trend: Trend, x: Floats, y: Floats) -> Floats:
    """β that minimises ‖y − h(x; β)‖² in units of a rough noise, and the prior."""

    def residuals(beta: Floats) -> Floats:
        misfit = (trend.value(beta, x) - y).ravel() / PRIOR_NOISE
        return np.concatenate([misfit, (beta - trend.prior_mean) / trend.prior_std])

    def jacobian(beta: Floats) -> Floats:
        rows = trend.parameter_jacobian(beta, x).reshape(-1, len(beta)) / PRIOR_NOISE
        return np.concatenate([rows, np.diag(1.0 / trend.prior_std)])

    return np.asarray(least_squares(residuals, trend.start(x, y), jac=jacobian, method="lm", x_scale="jac").x)
