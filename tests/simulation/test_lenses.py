"""Every lens keeps the protocol; each agrees with an independent source of truth where there is one."""

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.simulation.lenses import (
    LENSES,
    BrownConrady,
    Bump,
    Fisheye,
    Lens,
    Mirror,
    Pinhole,
    Resized,
    Unity,
    WaterPane,
    Windscreen,
)
from pinholify.simulation.lenses.mirror import reflect
from pinholify.simulation.lenses.water import refract


def pixels(lens: Lens, columns: int = 61, rows: int = 47) -> np.ndarray:
    w, h = lens.size
    grid = np.meshgrid(np.linspace(0, w - 1, columns), np.linspace(0, h - 1, rows))
    return np.stack(grid, axis=-1).reshape(-1, 2)


def points_before(lens: Lens, uv: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rays = lens.unproject(uv)
    distance = np.exp(np.random.default_rng(seed).uniform(np.log(2), np.log(200), (len(uv), 1)))
    return rays.origins + distance * rays.directions, distance[:, 0]


def off_ray(points: np.ndarray, rays: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    d = points - rays[0]
    return np.linalg.norm(d - (d * rays[1]).sum(axis=1, keepdims=True) * rays[1], axis=1)


@pytest.fixture(params=LENSES, scope="module")
def lens(request: pytest.FixtureRequest) -> Lens:
    return LENSES[request.param]


def test_rays_are_unit_vectors_or_nan(lens: Lens) -> None:
    origins, directions = lens.unproject(pixels(lens))
    assert origins.shape == directions.shape == (61 * 47, 3)
    seen = np.isfinite(directions).all(axis=1)
    assert seen.mean() > 0.4
    assert np.abs(np.linalg.norm(directions[seen], axis=1) - 1).max() < 1e-14
    assert np.isnan(directions[~seen]).all()


def test_a_lens_says_whether_it_is_central(lens: Lens) -> None:
    origins = lens.unproject(pixels(lens)).origins
    assert lens.central == bool((origins == 0).all())


def test_rays_to_pixels_to_rays(lens: Lens) -> None:
    uv = pixels(lens)
    rays = lens.unproject(uv)
    points, distance = points_before(lens, uv)
    seen = np.isfinite(points).all(axis=1)
    back = lens.project(points)
    assert np.isnan(back[~seen]).all()
    assert np.abs(back - uv)[seen].max() < 1e-7
    again = lens.unproject(back[seen])
    if lens.central:
        assert np.linalg.norm(again.directions - rays.directions[seen], axis=1).max() < 1e-9
    assert (off_ray(points[seen], again) / distance[seen]).max() < 1e-9


def test_projection_is_smooth_in_the_point(lens: Lens) -> None:
    uv = pixels(lens, 9, 7)
    points, distance = points_before(lens, uv)
    moved = points + 1e-6 * distance[:, None]
    shift = np.linalg.norm(lens.project(moved) - lens.project(points), axis=1)
    assert np.nanmax(shift) < 0.05


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_random_points_return_to_their_rays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for lens in LENSES.values():
        uv = rng.uniform(0, lens.size, (20, 2))
        points, distance = points_before(lens, uv, seed)
        seen = np.isfinite(points).all(axis=1)
        assert (off_ray(points, lens.unproject(lens.project(points))) / distance)[seen].max(initial=0) < 1e-9


def random_points(seed: int, n: int = 500, wide: float = 0.8) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(1, 10, (n, 1))
    return np.concatenate([rng.uniform(-wide, wide, (n, 2)) * depth, depth], axis=1)


PRISM = (0.01, -0.003, -0.008, 0.002)


@pytest.mark.parametrize(
    "numbers",
    [
        {"radial": (-0.28, 0.11, -0.02)},
        {"radial": (0.1, -0.05, 0.01), "tangential": (0.002, -0.003)},
        {"radial": (0.9, 0.14, 0.004), "denominator": (1.2, 0.35, 0.02)},
        {"radial": (-0.1, 0.02, 0.0), "thin_prism": PRISM},
        {"radial": (-0.1, 0.02, 0.0), "tilt": (0.12, -0.2)},
        {"radial": (0.3, 0.14, 0.004), "denominator": (0.5, 0.3, 0.02), "tangential": (0.002, -0.003),
         "thin_prism": PRISM, "tilt": (-0.05, 0.09)},
    ],
)
def test_brown_conrady_is_opencv(numbers: dict[str, tuple[float, ...]]) -> None:
    lens = BrownConrady((1280, 960), (900.0, 910.0), (5.0, -7.0), **numbers)
    k1, k2, k3 = lens.radial
    coefficients = np.array([k1, k2, *lens.tangential, k3, *lens.denominator, *lens.thin_prism, *lens.tilt])
    camera = np.array([[900.0, 0, 639.5 + 5], [0, 910.0, 479.5 - 7], [0, 0, 1]])
    points = random_points(1, wide=0.6)
    oracle = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, coefficients)[0].reshape(-1, 2)
    assert np.abs(lens.project(points) - oracle).max() < 1e-9


def test_brown_conrady_knows_its_own_derivative() -> None:
    lens = LENSES["rational-prism-tilt"]
    assert isinstance(lens, BrownConrady)
    lens = dataclasses.replace(lens, tangential=(0.02, -0.03), thin_prism=(0.01, -0.02, 0.03, 0.015))
    xy, rows = np.random.default_rng(6).uniform(-0.7, 0.7, (50, 2)), np.arange(50)
    for axis, step in enumerate(np.eye(2) * 1e-6):
        numeric = (lens._distort(xy + step, rows)[0] - lens._distort(xy - step, rows)[0]) / 2e-6
        assert np.abs(lens._distort(xy, rows)[1][:, :, axis] - numeric).max() < 1e-8


def test_fisheye_is_opencv() -> None:
    k = (0.03, -0.01, 0.004, -0.0006)
    lens = Fisheye((1600, 1200), 560.0, k, (6.0, -9.0))
    camera = np.array([[560.0, 0, 799.5 + 6], [0, 560.0, 599.5 - 9], [0, 0, 1]])
    points = random_points(2)
    oracle = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), camera, np.array(k))[0]
    assert np.abs(lens.project(points) - oracle.reshape(-1, 2)).max() < 1e-9


def test_fisheye_sees_behind_itself() -> None:
    lens = Fisheye((1600, 1200), 500.0)
    uv = lens.project(np.array([[1.0, 0.0, -0.2], [0.0, -3.0, 0.0]]))
    right = 500 * (np.pi / 2 + np.arctan(0.2))
    assert np.allclose(uv, [[799.5 + right, 599.5], [799.5, 599.5 - 250 * np.pi]])


def test_a_fisheye_does_not_fold() -> None:
    """θ(1 - 0.2 θ²) turns back at θ = √(1/0.6)."""
    lens, turn = Fisheye((1600, 1200), 500.0, (-0.2, 0.0, 0.0, 0.0)), np.sqrt(1 / 0.6)
    angles = np.array([0.999, 1.001]) * turn
    inside, outside = lens.project(np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1))
    assert np.isfinite(inside).all()
    assert np.isnan(outside).all()
    rim = 799.5 + 500 * turn * (1 - 0.2 * turn**2)
    assert np.isnan(lens.unproject(np.array([[rim + 1, 599.5]])).directions).all()


def test_brown_conrady_does_not_fold() -> None:
    """With k1 alone r(1 + k1 r²) turns back at r = √(-1/(3 k1)): points beyond it have no pixel."""
    lens = BrownConrady((1280, 960), (900.0, 900.0), radial=(-0.3, 0.0, 0.0))
    turn = np.sqrt(1 / 0.9)
    inside, outside = lens.project(np.array([[0.999 * turn, 0, 1], [1.001 * turn, 0, 1]]))
    assert np.isfinite(inside).all()
    assert np.isnan(outside).all()
    edge = 639.5 + 900 * turn * (1 - 0.3 * turn**2)
    assert np.isnan(lens.unproject(np.array([[edge + 1, 479.5]])).directions).all()


@pytest.mark.parametrize("intensity", [55.0, -40.0, 5.0])
def test_unity_by_its_formula_at_single_points(intensity: float) -> None:
    """Right of the centre, at a quarter of the width: the formula in plain scalars."""
    theta = np.deg2rad(1.6 * abs(intensity))
    sigma = 2 * np.tan(theta / 2)
    r = np.tan(theta * 0.25) / sigma if intensity > 0 else np.arctan(sigma * 0.25) / theta
    lens = Unity((3840, 2160), 2000.0, intensity)
    direction = lens.unproject(np.array([[0.75 * 3840 - 0.5, 1079.5]])).directions[0]
    assert direction[0] / direction[2] == pytest.approx(r * 3840 / 2000, rel=1e-12)
    assert abs(direction[1]) < 1e-12


@pytest.mark.parametrize("lens", [Pinhole((640, 480), 500.0), BrownConrady((640, 480), (500.0, 500.0)),
                                  Unity((640, 480), 500.0, 50.0)])
def test_points_behind_a_flat_lens_have_no_pixel(lens: Lens) -> None:
    assert np.isnan(lens.project(np.array([[0.1, 0.2, -1.0], [0.1, 0.2, 0.0]]))).all()


def test_a_bump_shifts_by_its_shift_along_its_slope() -> None:
    bump = Bump((100.0, 50.0), 20.0, 3.0)
    shift = bump.bend(np.array([[120.0, 50.0], [100.0, 50.0]]))
    assert np.allclose(shift, [[3.0, 0.0], [0.0, 0.0]])
    left, right = bump.bend(np.array([[110.0 - 1e-5, 60.0], [110.0 + 1e-5, 60.0]]))
    numeric = (right - left) / 2e-5
    assert np.allclose(bump.slope(np.array([[110.0, 60.0]]))[0][:, 0], numeric, atol=1e-8)


def test_a_windscreen_before_a_lens_without_centre_has_none() -> None:
    water = WaterPane(Pinhole((640, 480), 500.0), 1.0, 0.1)
    assert not Windscreen(water, (Bump((1.0, 1.0), 9.0, 1.0),)).central


def test_refraction_obeys_snell() -> None:
    """n₁ sin α = n₂ sin β, both rays and the normal in one plane; no light beyond the critical angle."""
    normal = np.array([0.6, 0.0, 0.8])
    angles = np.deg2rad([0.0, 10.0, 35.0, 60.0])
    sideways = np.array([0.8, 0.0, -0.6])
    into = np.cos(angles)[:, None] * normal + np.sin(angles)[:, None] * sideways
    out = refract(into, normal, 1 / 1.333)
    assert np.allclose(np.sin(angles), 1.333 * (out @ sideways), atol=1e-14)
    assert np.allclose(np.linalg.norm(out, axis=1), 1)
    assert np.abs(out[:, 1]).max() == 0
    assert np.isnan(refract(into[3:], normal, 1.333)).all()


def test_a_pane_of_air_changes_nothing() -> None:
    pinhole = Pinhole((640, 480), 500.0)
    air = WaterPane(pinhole, 1.0, 0.4, (0.1, 0.2, 1.0), glass_index=1.0, water_index=1.0)
    points = random_points(3, wide=0.3) * 2
    assert np.allclose(air.project(points), pinhole.project(points), atol=1e-9)


def test_water_magnifies_near_the_axis_by_its_index() -> None:
    pane = WaterPane(Pinhole((640, 480), 500.0), 1e-9, 0.0)
    uv = pane.project(np.array([[1e-4, 0.0, 10.0]]))
    assert (uv[0, 0] - 319.5) / (500 * 1e-5) == pytest.approx(1.333, rel=1e-6)


def test_points_on_the_dry_side_have_no_pixel() -> None:
    pane = WaterPane(Pinhole((640, 480), 500.0), 1.0, 0.2)
    assert np.isnan(pane.project(np.array([[0.0, 0.0, 1.1]]))).all()


def test_reflection_obeys_its_law() -> None:
    """Angles of incidence and reflection are equal, and the normal's plane holds both."""
    rng = np.random.default_rng(4)
    d, n = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, 50, 3)))
    out = reflect(d, n)
    assert np.allclose((out * n).sum(axis=1), -(d * n).sum(axis=1), atol=1e-14)
    assert np.abs(np.linalg.det(np.stack([d, n, out], axis=1))).max() < 1e-14


def test_a_flat_mirror_is_a_camera_behind_it() -> None:
    """A point before a flat mirror appears where the pinhole sees its mirror image."""
    pinhole = Pinhole((640, 480), 500.0)
    mirror = Mirror(pinhole, 5.0, 0.0, 0.0, 50.0, tilt=20.0)
    points = random_points(5, wide=0.2) * [1, 1, -1]
    normal = np.array([0.0, -np.sin(np.deg2rad(20)), np.cos(np.deg2rad(20))])
    height = (points - [0, 0, 5.0]) @ normal
    images = points - 2 * height[:, None] * normal
    assert np.abs(mirror.project(points) - pinhole.project(images)).max() < 1e-9


def test_a_mirrors_rays_hit_its_surface_and_reflect_about_its_normal() -> None:
    a, b, distance = 0.02, 0.001, 6.0
    pinhole = Pinhole((640, 480), 700.0)
    uv = pixels(pinhole, 11, 9)
    origins, directions = Mirror(pinhole, distance, a, b, 9.0).unproject(uv)
    r2 = (origins[:, :2] ** 2).sum(axis=1)
    assert np.abs(origins[:, 2] - distance - a * r2 - b * r2**2).max() < 1e-12
    incoming = pinhole.unproject(uv).directions
    assert np.abs(np.cross(origins, incoming)).max() < 1e-11
    slope = (2 * a + 4 * b * r2)[:, None] * origins[:, :2]
    half = directions - incoming
    assert np.abs(half[:, :2] / half[:, 2:] + slope).max() < 1e-12


def test_a_mirror_shows_nothing_beyond_its_rim_or_behind_it() -> None:
    mirror = Mirror(Pinhole((640, 480), 500.0), 6.0, 0.02, 0.001, 1.0)
    assert np.isnan(mirror.unproject(np.array([[0.0, 240.0]])).directions).all()
    assert np.isnan(mirror.project(np.array([[0.0, 0.0, 7.0], [30.0, 0.0, 4.0]]))).all()


def test_glass_and_mirrors_need_a_centre() -> None:
    water = WaterPane(Pinhole((640, 480), 500.0), 1.0, 0.1)
    with pytest.raises(ValueError, match="single centre"):
        WaterPane(water, 1.0, 0.1)
    with pytest.raises(ValueError, match="single centre"):
        Mirror(water, 5.0, 0.1, 0.0, 9.0)
    with pytest.raises(ValueError, match="not convex"):
        Mirror(Pinhole((640, 480), 500.0), 5.0, -0.1, 0.0, 9.0)


def test_resizing_keeps_the_edges_of_the_image() -> None:
    lens = Pinhole((1280, 960), 900.0)
    half = Resized(lens, (640, 480))
    whole_edge, half_edge = (v.unproject(np.array([[-0.5, -0.5]])).directions for v in (lens, half))
    assert np.allclose(whole_edge, half_edge)
    assert np.allclose(half.project(np.array([[0.0, 0.0, 1.0]])), [[319.5, 239.5]])
