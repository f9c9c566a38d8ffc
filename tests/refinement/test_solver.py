"""The linear algebra against slow and plain twins: dense least squares, and a dense Gaussian's marginal likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pinholify.board import Checkerboard, Screen, lattice
from pinholify.refinement.basis import sine_basis
from pinholify.refinement.evidence import (
    Hyperparameters,
    _information,
    _scored,
    maximise_evidence,
    nested_noise,
    posterior,
    process_averaged,
    reduced_problem,
)
from pinholify.refinement.model import Model, State
from pinholify.refinement.normal import eliminate
from pinholify.refinement.observations import Observations, image_frame, lattice_middle, observations
from pinholify.refinement.shape import BoardShape, board_shape
from pinholify.refinement.solver import Loss, huber_loss, huber_weights, minimise, robust_scale
from pinholify.refinement.spectral import density_named
from pinholify.refinement.surface import surface_functions
from pinholify.refinement.trends import LensTrend, Plane

from .conftest import BOARD, FOCAL, SIZE, Scene, make_scene

FRAME = image_frame(SIZE, False)


def flattened(scene: Scene) -> Observations:
    return observations(scene.corners.views, BOARD, FRAME)


def truth(scene: Scene, model: Model) -> State:
    """The true state of a pinhole scene under a ``plane`` trend without distortion."""
    beta = np.zeros(len(model.trend.prior_std))
    beta[0] = FRAME.scale / FOCAL
    centre = slice(3, 5) if model.trend.anisotropic else slice(1, 3)
    beta[centre] = FRAME.normalise(np.array([401.0, 297.0]))
    middle = np.append(lattice_middle(BOARD), 0.0)
    eta = np.zeros(len(model.shape.prior_std))
    still = State.still(beta, eta, scene.rotations, scene.translations + scene.rotations @ middle)
    return replace(still, weights=np.zeros((len(model.basis), 2)))


def small_model(length_scale: float = 0.8, *, extended: bool = False) -> Model:
    """``extended`` by a warp of the board and motions of the boards."""
    model = Model(LensTrend(Plane(), False, 1), sine_basis(FRAME.half_size, length_scale), board_shape(BOARD))
    return replace(model, shape=model.shape.warped(0.01, 0.02), motion=0.3) if extended else model


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_scene("pinhole", views=4)


def disturbed(model: Model, state: State) -> State:
    rng = np.random.default_rng(5)
    theta = 1e-2 * rng.normal(size=len(state.globals))
    own = 9 if model.motion else 6
    return state.moved(theta, 1e-2 * rng.normal(size=(len(state.rotations), own)))


@pytest.mark.parametrize("extended", [False, True])
def test_derivatives_of_the_model(scene: Scene, extended: bool) -> None:
    model, seen = small_model(extended=extended), flattened(scene)
    state = disturbed(model, truth(scene, model))
    at = model.predict(state, seen)
    linear = model.linearise(state, seen, at)
    m, size, boards = len(model.basis), len(state.globals), len(scene.rotations)
    for i, step in enumerate(1e-6 * np.eye(size)):
        ahead, behind = (model.predict(state.moved(s, np.zeros((boards, 6))), seen).residual for s in (step, -step))
        if i < 2 * m:
            expected = np.zeros((len(seen.view), 2))
            expected[:, i // m] = linear.basis[:, i % m]
        else:
            expected = linear.shared[:, :, i - 2 * m]
        np.testing.assert_allclose(-(ahead - behind) / 2e-6, expected, atol=1e-6)
    assert linear.pose.shape[2] == (9 if extended else 6)
    for i, step in enumerate(1e-6 * np.eye(linear.pose.shape[2])):
        moves = [np.tile(sign * step, (boards, 1)) for sign in (1, -1)]
        ahead, behind = (model.predict(state.moved(np.zeros(size), move), seen).residual for move in moves)
        np.testing.assert_allclose(-(ahead - behind) / 2e-6, linear.pose[:, :, i], atol=1e-6)
    points = model.shape.seen_points(state.eta, seen)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        moved = [replace(model, shape=_Moved(model.shape, points + sign * step)) for sign in (1, -1)]
        ahead, behind = (each.predict(state, seen).residual for each in moved)
        np.testing.assert_allclose(-(ahead - behind) / 2e-6, model.by_point(state, seen, at)[:, :, axis], atol=1e-6)


class _Moved:
    """A board whose points are given."""

    def __init__(self, shape: BoardShape, points: np.ndarray) -> None:
        self.prior_std, self.points = shape.prior_std, points

    def seen_points(self, eta: np.ndarray, seen: Observations) -> np.ndarray:
        return self.points


def dense_jacobian(linear, seen: Observations) -> np.ndarray:
    n, m = linear.basis.shape
    zero = np.zeros((n, m))
    globals_ = np.concatenate(
        [np.stack([np.hstack([linear.basis, zero]), np.hstack([zero, linear.basis])], axis=1), linear.shared], axis=2
    )
    own = linear.pose.shape[2]
    poses = np.zeros((n, 2, own * seen.boards))
    for i in range(n):
        poses[i, :, own * seen.view[i] : own * (seen.view[i] + 1)] = linear.pose[i]
    return np.concatenate([globals_, poses], axis=2).reshape(2 * n, -1)


def test_a_pose_without_a_solution_has_no_equations(scene: Scene) -> None:
    model, seen = small_model(), flattened(scene)
    state = truth(scene, model)
    at = model.predict(state, seen)
    linear = model.linearise(state, seen, at)
    astray = np.where(seen.view[:, None, None] == 2, np.nan, linear.pose)
    with pytest.raises(np.linalg.LinAlgError):
        eliminate(replace(linear, pose=astray), at.residual, np.ones(len(seen.view)), seen)


@pytest.mark.parametrize("extended", [False, True])
def test_elimination_is_the_dense_schur_complement(scene: Scene, extended: bool) -> None:
    model, seen = small_model(extended=extended), flattened(scene)
    state = disturbed(model, truth(scene, model))
    at = model.predict(state, seen)
    linear = model.linearise(state, seen, at)
    weight = np.random.default_rng(1).uniform(0.5, 1.5, len(seen.view))
    equations = eliminate(linear, at.residual, weight, seen)
    jacobian = dense_jacobian(linear, seen) * np.repeat(np.sqrt(weight), 2)[:, None]
    r = at.residual.ravel() * np.repeat(np.sqrt(weight), 2)
    size = len(state.globals)
    hessian, right = jacobian.T @ jacobian, jacobian.T @ r
    stiff, moved = np.tile(linear.stiffness, seen.boards), linear.moved.ravel()
    assert (moved[stiff > 0] != 0).all()
    hessian[size:, size:] += np.diag(stiff)
    right[size:] -= stiff * moved
    c, e = hessian[size:, size:], hessian[:size, size:]
    np.testing.assert_allclose(equations.matrix, hessian[:size, :size] - e @ np.linalg.solve(c, e.T), atol=1e-8)
    np.testing.assert_allclose(equations.right, right[:size] - e @ np.linalg.solve(c, right[size:]), atol=1e-8)
    np.testing.assert_allclose(
        equations.log_det_poses, np.linalg.slogdet(c)[1] - np.log(stiff[stiff > 0]).sum(), rtol=1e-10
    )
    left = r @ r + stiff @ moved**2 - right[size:] @ np.linalg.solve(c, right[size:])
    np.testing.assert_allclose(equations.misfit, left, rtol=1e-8)
    step = np.random.default_rng(2).normal(size=size)
    poses = np.linalg.solve(c, right[size:] - e.T @ step)
    np.testing.assert_allclose(equations.pose_steps(step).ravel(), poses, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("extended", [False, True])
def test_evidence_is_the_marginal_likelihood_of_a_dense_gaussian(scene: Scene, extended: bool) -> None:
    """Poses get a very wide prior; its volume is the only thing that the evidence leaves out."""
    model, seen = small_model(extended=extended), flattened(scene)
    density, _ = density_named("se")
    state = truth(scene, model)
    at = model.predict(state, seen)
    linear = model.linearise(state, seen, at)
    frequencies = model.basis.frequencies
    problem = reduced_problem(model, state, seen, at)[0]
    jacobian, wide = dense_jacobian(linear, seen), 300.0

    def difference(hyper: Hyperparameters) -> float:
        precision = hyper.precision(density, frequencies, model.trend_precision())
        own = np.full(linear.pose.shape[2], wide**2)
        own[6:] = (model.motion * hyper.noise) ** 2
        prior = np.append(1.0 / precision, np.tile(own, seen.boards))
        covariance = (jacobian * prior) @ jacobian.T + hyper.noise**2 * np.eye(len(jacobian))
        # y = r + J θ₀ with the prior mean of θ at zero, that of the poses at their present place.
        y = at.residual.ravel() + jacobian[:, : len(precision)] @ state.globals
        exact = multivariate_normal(np.zeros(len(y)), covariance).logpdf(y)
        return exact - posterior(problem, precision, hyper.noise).log_evidence

    one = difference(Hyperparameters(np.log([0.03, 0.8]), 0.02))
    other = difference(Hyperparameters(np.log([0.1, 1.0]), 0.03))
    volume = -6 * seen.boards * (np.log(wide) + 0.5 * np.log(2 * np.pi))
    poses = 0.5 * 6 * seen.boards * np.log(2 * np.pi)
    np.testing.assert_allclose([one, other], volume + poses, atol=0.05)


def test_evidence_of_a_process_switched_off_around_one_that_was_on(scene: Scene) -> None:
    """Rounding once made it higher than any other, so that a long step of the search ended there."""
    model, seen = small_model(0.2), flattened(scene)
    density, _ = density_named("se")
    state = disturbed(model, truth(scene, model))
    at = model.predict(state, seen)
    frequencies, prior = model.basis.frequencies, model.trend_precision()
    problem = reduced_problem(model, state, seen, at)[0]
    off = Hyperparameters(np.log([1e-9, 1.0]), 1e-4).precision(density, frequencies, prior)
    expected = posterior(problem.without_process(), prior, 1e-4).log_evidence
    assert np.abs(state.weights).min() > 0
    assert posterior(problem, off, 1e-4).log_evidence == pytest.approx(expected, rel=1e-6)


def test_gradient_of_the_evidence(scene: Scene) -> None:
    model, seen = small_model(), flattened(scene)
    density, _ = density_named("se")
    state = truth(scene, model)
    at = model.predict(state, seen)
    problem = reduced_problem(model, state, seen, at)[0]

    p = np.log([1e-3, 0.8, 2e-4])
    gradient = _scored(problem, density, p, 0.1).gradient
    for i, h in enumerate(1e-5 * np.eye(3)):
        values = [_scored(problem, density, near, 0.1).value for near in (p + h, p - h)]
        np.testing.assert_allclose(gradient[i], (values[0] - values[1]) / 2e-5, rtol=1e-4, atol=1e-3)


def test_information_is_half_the_trace_of_what_the_covariance_does() -> None:
    """½ tr(K⁻¹ ∂K K⁻¹ ∂K') in the dense form, for data y = J θ + noise."""
    rng, noise = np.random.default_rng(0), 0.7
    jacobian, slopes, prior = rng.normal(size=(30, 7)), rng.normal(size=(4, 2)), rng.uniform(0.5, 2.0, 7)
    precision = np.linalg.inv(noise**2 * np.eye(30) + (jacobian * prior) @ jacobian.T)
    varied = [(jacobian[:, :4] * (prior[:4] * slope)) @ jacobian[:, :4].T for slope in slopes.T]
    products = [precision @ each for each in (*varied, 2.0 * noise**2 * np.eye(30))]
    whitened = jacobian * np.sqrt(prior) / noise
    posterior_covariance = np.linalg.inv(np.eye(7) + whitened.T @ whitened)
    np.testing.assert_allclose(
        _information(np.tril(posterior_covariance), slopes, 30 - 7),
        [[0.5 * np.trace(a @ b) for b in products] for a in products],
    )


def test_removed_unknowns_are_as_if_they_had_never_been(scene: Scene) -> None:
    big, small = (
        small_model(),
        Model(LensTrend(Plane(), False, 1, tangent=False), small_model().basis, board_shape(BOARD)),
    )
    seen = flattened(scene)
    problems = []
    for model in (big, small):
        state = truth(scene, model)
        at = model.predict(state, seen)
        problems.append(reduced_problem(model, state, seen, at)[0])
    removed = np.zeros(len(problems[0].theta), dtype=bool)
    first = 2 * len(big.basis)
    removed[first : first + len(big.trend.prior_std)] = ~big.trend.kept(small.trend)
    cut = problems[0].without(removed)
    np.testing.assert_allclose(cut.matrix, problems[1].matrix, atol=1e-8)
    np.testing.assert_allclose(cut.right, problems[1].right, atol=1e-10)
    assert cut.without_process().frequencies.shape == (0, 2)


def test_hyperparameters_and_noise_are_found_again() -> None:
    """A process and noise of known size, drawn from the model itself."""
    scene = make_scene("pinhole", views=16, noise=0.0)
    model, seen = small_model(0.3), flattened(scene)
    density, _ = density_named("se")
    state, rng = truth(scene, model), np.random.default_rng(8)
    at = model.predict(state, seen)
    true = Hyperparameters(np.log([2e-3, 0.4]), 2e-4)
    std = np.exp(0.5 * density(true.kernel, model.basis.frequencies)[0])
    g = model.basis.values(at.undisplaced) @ (std[:, None] * rng.normal(size=(len(std), 2)))
    residual = g + true.noise * rng.normal(size=g.shape)
    problem = reduced_problem(model, state, seen, replace(at, residual=residual))[0]
    start = Hyperparameters(np.log([1e-4, 0.7]), 1e-3)
    found = maximise_evidence(problem, density, start, shortest=0.0, resolved=0.3).hyperparameters
    assert found.noise == pytest.approx(true.noise, rel=0.05)
    np.testing.assert_allclose(found.kernel, true.kernel, atol=0.5)  # the area is but a few length scales wide


def test_noise_alone_is_the_fixed_point_of_its_evidence(scene: Scene) -> None:
    model, seen = small_model(), flattened(scene)
    state = truth(scene, model)
    at = model.predict(state, seen)
    problem = reduced_problem(model, state, seen, at)[0].without_process()
    kept = np.ones((2, len(problem.theta)), dtype=bool)
    kept[1, -2:] = False  # without the board's print
    found = nested_noise(problem, kept, 1e-2)
    for one, noise, theta, best in zip(kept, found.noise, found.theta, found.log_evidence, strict=True):
        part = problem.without(~one)
        at_best = posterior(part, part.precision, noise)
        assert best == pytest.approx(at_best.log_evidence, abs=1e-5)
        np.testing.assert_allclose(theta[one], part.theta + at_best.delta, rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(theta[~one], 0.0)
        for factor in (0.98, 1.02):
            assert posterior(part, part.precision, factor * noise).log_evidence < best


def test_minimise_finds_the_truth_from_afar() -> None:
    scene = make_scene("pinhole", views=10, noise=0.0)
    model = Model(LensTrend(Plane(), False, 1, tangent=False), small_model().basis, board_shape(BOARD))
    seen, true = flattened(scene), truth(scene, model)
    precision = np.append(np.full(true.weights.size, 1e6), model.trend_precision())
    found = minimise(model, disturbed(model, true), seen, precision, Loss(1e-6), most_steps=60, tolerance=1e-9)
    assert found is not None
    assert np.abs(found.prediction.residual).max() < 1e-7


def test_poses_alone_leave_the_camera_alone(scene: Scene) -> None:
    model, seen = small_model(), flattened(scene)
    true = truth(scene, model)
    moved = true.moved(np.zeros(len(true.globals)), np.full((4, 6), 0.02))
    found = minimise(model, moved, seen, np.ones(len(true.globals)), Loss(1e-3), poses_only=True)
    assert found is not None
    np.testing.assert_array_equal(found.state.globals, true.globals)
    assert found.noise == 1e-3
    np.testing.assert_allclose(found.state.rotations, true.rotations, atol=2e-3)


def test_a_state_that_sees_nothing_is_no_start(scene: Scene) -> None:
    model, seen = small_model(), flattened(scene)
    true = truth(scene, model)
    behind = replace(true, translations=-true.translations)
    assert minimise(model, behind, seen, np.ones(len(true.globals)), Loss()) is None


def test_huber() -> None:
    length = np.array([0.5, 2.0, 5.0])
    np.testing.assert_allclose(huber_loss(length, 2.0), [0.25, 4.0, 16.0])
    np.testing.assert_allclose(huber_loss(length, np.inf), length**2)
    np.testing.assert_allclose(huber_weights(length, 2.0), [1.0, 1.0, 0.4])
    draws = np.random.default_rng(0).normal(size=(20000, 2)) * 0.3
    assert robust_scale(np.linalg.norm(draws, axis=1)) == pytest.approx(0.3, rel=0.02)


def test_shape_is_even_and_leaves_planes_to_the_poses() -> None:
    shape = board_shape(BOARD)
    eta = np.append(np.random.default_rng(0).normal(size=6), [0.01, -0.02])
    points = shape.points(eta)
    np.testing.assert_allclose(points[:, 2], points[::-1, 2])  # half a turn counts the corners backwards
    np.testing.assert_allclose(points[:, 1], 1.01 * shape.flat[:, 1])
    np.testing.assert_allclose(points[:, 0], shape.flat[:, 0] - 0.02 * shape.flat[:, 1])
    assert (shape.stretch(eta), shape.shear(eta)) == (0.01, -0.02)
    assert [s.prior_std.size for s in shape.smaller()] == [8, 6, 2, 0]
    assert [s.options for s in shape.smaller()] == [2, 1, 1, 0]


def test_a_warped_shape_carries_what_it_was(scene: Scene) -> None:
    shape, seen = board_shape(BOARD), flattened(scene)
    warped, rng = shape.warped(0.01, 0.02), np.random.default_rng(0)
    eta = 0.01 * rng.normal(size=8)
    np.testing.assert_allclose(warped.points(warped.carried(eta, shape)), shape.points(eta))
    np.testing.assert_allclose(shape.carried(warped.carried(eta, shape), warped), eta)
    assert warped.smaller() == [warped]
    several = warped.prior_std * rng.normal(size=(2000, len(warped.prior_std)))
    shifts = np.array([warped.warp(each) for each in several])
    np.testing.assert_allclose(shifts.std(axis=(0, 1)), [0.01, 0.01, 0.02], rtol=0.05)
    planes = np.column_stack([np.ones(54), warped.flat])
    np.testing.assert_allclose(np.einsum("ni,knj->kij", planes, shifts), 0.0, atol=1e-12)
    both = warped.warped(0.02, 0.01)
    np.testing.assert_array_equal(both.functions, warped.functions)
    np.testing.assert_allclose(both.prior_std[8::51], [0.02, 0.02, 0.01])
    misplaced = replace(seen, placed=seen.view != 1)
    expected, found = warped.seen_points(several[0], seen), warped.seen_points(several[0], misplaced)
    np.testing.assert_array_equal(found[seen.view != 1], expected[seen.view != 1])
    unwarped = warped.points(warped.carried(shape.carried(several[0], warped), shape))
    np.testing.assert_allclose(found[seen.view == 1], unwarped)


def test_a_surface_over_many_corners_is_the_one_through_some() -> None:
    few, many = Checkerboard(20, 19), Checkerboard(40, 20)
    assert surface_functions(lattice(few)).shape == (380, 60)
    functions = surface_functions(lattice(many))
    assert functions.shape == (800, 60)
    assert (functions**2).sum(axis=1).mean() == pytest.approx(1.0)
    planes = np.column_stack([np.ones(800), lattice(many)])
    taken = np.linalg.lstsq(planes, functions, rcond=None)[1]
    assert taken.sum() == pytest.approx((functions**2).sum())


def test_averaging_the_process_leaves_the_evidence(scene: Scene) -> None:
    model = small_model()
    seen, (density, _) = flattened(scene), density_named("se")
    state = disturbed(model, truth(scene, model))
    at = model.predict(state, seen)
    problem = reduced_problem(model, state, seen, at)[0]
    hyper = Hyperparameters(np.log([0.01, 0.4]), 3e-4)
    precision = hyper.precision(density, problem.frequencies, problem.precision)
    whole = posterior(problem, precision, hyper.noise)
    averaged = process_averaged(problem, density, hyper)
    found = posterior(averaged, averaged.precision, hyper.noise)
    assert found.log_evidence == pytest.approx(whole.log_evidence, abs=1e-5)
    np.testing.assert_allclose(found.delta, whole.delta[2 * len(problem.frequencies) :], rtol=1e-5, atol=1e-9)


def test_a_screen_may_be_bent_and_nothing_else() -> None:
    """Its pixels are a true square lattice, which paper need not be."""
    screen, paper = board_shape(Screen(320, 192)), board_shape(BOARD)
    assert screen.has("bend")
    assert not screen.has("stretch")
    assert paper.has("stretch")
    assert len(screen.smaller()) == 2
