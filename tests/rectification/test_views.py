"""Views: what a pixel of each looks at, how wide they are, and that what is kept is what was asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import AngleChart, Intrinsics
from pinholify.errors import CalibrationError, InputError
from pinholify.geometry import convex_hull
from pinholify.io.export.base import pinhole_export
from pinholify.rectification.maps import rectification_map, remap
from pinholify.rectification.options import VIEWS, ViewOptions
from pinholify.rectification.rectangle import largest_rectangle
from pinholify.rectification.straightener import Straightener
from pinholify.rectification.surfaces import SURFACES, CylindricalSurface, FlatSurface, SphericalSurface
from pinholify.rectification.valid_region import source_mask, valid_pixels
from pinholify.rectification.views import View, named_view, share_outside

SIZE = (640, 480)
SCALE = 200.0  # px a radian: 183° across, 137° down
MIDDLE = (np.array(SIZE) - 1) / 2.0
CORNERS = np.array([[0.0, 0.0], [639, 0], [639, 479], [0, 479]])


class EquidistantMap:
    """An ideal fisheye whose axis is the frame's z: ray angles are pixels, and known to a tenth of a px everywhere."""

    def value(self, uv):
        return (uv - MIDDLE) / SCALE

    def jacobian(self, uv):
        return np.broadcast_to(np.eye(2) / SCALE, (len(uv), 2, 2))

    def covariance_up_to_turn(self, uv):
        std = 0.1 * (1.0 + np.linalg.norm(uv - MIDDLE, axis=1) / 100.0) / SCALE
        return std[:, None, None] ** 2 * np.eye(2)

    def inverse(self, q, nearby):
        return q * SCALE + MIDDLE


@pytest.fixture(scope="module")
def fisheye():
    hull = Domain(convex_hull(CORNERS))
    return VirtualCamera(EquidistantMap(), AngleChart(np.eye(3), Intrinsics(9.0, 0.0, 0.0)), hull, SIZE, 0.1)


def directions_of(view, pixels):
    d = view.directions(np.atleast_2d(np.asarray(pixels, dtype=float)))
    return d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.parametrize("surface", SURFACES.values())
@given(yaw=st.floats(-75, 75), pitch=st.floats(-60, 60))
def test_coordinates_are_those_of_the_direction(surface, yaw, pitch):
    a, b = np.deg2rad([yaw, pitch])
    xyz = np.array([[np.sin(a) * np.cos(b), np.sin(b), np.cos(a) * np.cos(b)]])
    back = surface.directions(surface.coordinates(3.0 * xyz))
    np.testing.assert_allclose(back / np.linalg.norm(back), xyz, atol=1e-12)


def test_each_surface_by_its_definition():
    xyz = np.array([[1.0, 2.0, 1.0]])
    np.testing.assert_allclose(FlatSurface().coordinates(xyz), [[1.0, 2.0]])
    np.testing.assert_allclose(CylindricalSurface().coordinates(xyz), [[np.pi / 4, np.sqrt(2)]])
    np.testing.assert_allclose(SphericalSurface().coordinates(xyz), [[np.pi / 4, np.arctan(np.sqrt(2))]])


@pytest.mark.parametrize("name", ["camera", "board", "cylindrical", "equirectangular"])
def test_directions_and_pixels_are_inverse(fisheye, name):
    view = named_view(fisheye, ViewOptions(name, size=(300, 200), turn=(10.0, -5.0, 20.0), fov=100.0))
    pixels = np.random.default_rng(0).uniform(0, [299, 199], (100, 2))
    np.testing.assert_allclose(view.project(4.0 * directions_of(view, pixels)), pixels, atol=1e-9)


@pytest.mark.parametrize(("name", "fov"), [("camera", 80.0), ("cylindrical", 180.0), ("equirectangular", 360.0)])
def test_a_view_is_as_wide_as_was_asked(fisheye, name, fov):
    view = named_view(fisheye, ViewOptions(name, size=(300, 200), fov=fov))
    left, right = directions_of(view, [[-0.499999, 99.5], [299.499999, 99.5]])
    assert np.rad2deg(np.arctan2(right[0], right[2])) == pytest.approx(fov / 2, abs=1e-3)
    assert np.rad2deg(np.arctan2(left[0], left[2])) == pytest.approx(-fov / 2, abs=1e-3)


def test_a_full_equirectangular_picture_holds_every_direction_once(fisheye):
    view = named_view(fisheye, ViewOptions("equirectangular", size=(400, 200), fov=360.0))
    top, bottom = directions_of(view, [[100.0, -0.4999], [100.0, 199.4999]])
    np.testing.assert_allclose([top[1], bottom[1]], [-1.0, 1.0], atol=1e-5)
    beyond = view.directions(np.array([[-1.0, 50.0], [400.0, 50.0], [50.0, -1.0], [50.0, 200.0]]))
    assert np.isnan(beyond).any(axis=1).all()


@pytest.mark.parametrize(
    ("turn", "ahead", "right"),
    [
        ((90.0, 0.0, 0.0), [1, 0, 0], [0, 0, -1]),
        ((0.0, 90.0, 0.0), [0, -1, 0], [1, 0, 0]),
        ((0.0, 0.0, 90.0), [0, 0, 1], [0, 1, 0]),
        ((90.0, 90.0, 0.0), [0, -1, 0], [0, 0, -1]),
    ],
)
def test_turns_go_right_up_and_clockwise(fisheye, turn, ahead, right):
    rotation = named_view(fisheye, ViewOptions(turn=turn, fov=60.0)).rotation
    np.testing.assert_allclose(rotation[[2, 0]], [ahead, right], atol=1e-12)


def test_the_faces_of_a_cube_meet_at_their_edges(fisheye):
    cube = [name for name in VIEWS if name.startswith("cube-")]
    faces = {name: named_view(fisheye, ViewOptions(name, size=(200, 200))) for name in cube}

    def meet(one, at, other, there):
        ends = directions_of(faces[f"cube-{one}"], at), directions_of(faces[f"cube-{other}"], there)
        np.testing.assert_allclose(*ends, atol=1e-12)

    meet("front", [199.5, 30.0], "right", [-0.5, 30.0])
    meet("right", [199.5, 30.0], "back", [-0.5, 30.0])
    meet("back", [199.5, 30.0], "left", [-0.5, 30.0])
    meet("front", [30.0, -0.5], "up", [30.0, 199.5])
    meet("front", [30.0, 199.5], "down", [30.0, -0.5])


def test_a_face_of_a_cube_is_as_fine_as_the_middle_of_the_image(fisheye):
    assert named_view(fisheye, ViewOptions("cube-front")).size == (400, 400)


@pytest.mark.parametrize("name", ["cylindrical", "equirectangular"])
def test_a_view_all_around_shows_the_whole_image_and_no_more(fisheye, name):
    view = named_view(fisheye, ViewOptions(name, size=(400, 300)))
    v, u = (grid.ravel() for grid in np.mgrid[0:480:20, 0:640:20])
    directions = fisheye.chart.directions(fisheye.plane_map.value(np.column_stack([u, v]).astype(float)))
    seen = view.project(directions[SURFACES[VIEWS[name].surface].steepness(directions) < np.deg2rad(65.0)])
    assert (seen > -0.5).all()
    assert (seen < np.array([400, 300]) - 0.5).all()
    spread = (np.ptp(seen, axis=0) / [399, 299]).max()
    assert spread > 0.95


def with_corners_up_to(fisheye, degrees, max_std=np.inf):
    """Its corners reach that far from the axis, in all directions."""
    around = np.linspace(0.0, 2.0 * np.pi, 60)
    circle = MIDDLE + SCALE * np.deg2rad(degrees) * np.column_stack([np.cos(around), np.sin(around)])
    return replace(fisheye, domain=Domain(convex_hull(circle), max_std))


def seen_share(camera, view, uv):
    """The share of pixels ``uv`` that ``view`` shows."""
    seen = view.project(camera.chart.directions(camera.plane_map.value(uv)))
    return ((seen >= -0.5) & (seen <= np.array(view.size) - 0.5)).all(axis=1).mean()


def test_where_a_std_is_known_corners_are_no_limit_of_views(fisheye):
    """What pictures show is what the view is fitted to, and a stricter limit never shows more."""
    camera = with_corners_up_to(fisheye, 20.0, max_std=0.3)
    view = named_view(camera, ViewOptions(size=(400, 300)))
    known = np.argwhere(source_mask(camera, None))[:, ::-1].astype(float)
    assert seen_share(camera, view, known) == 1.0
    assert rectification_map(camera, view).valid.mean() > 0.5
    asked = [named_view(camera, ViewOptions(size=(400, 300), max_std=limit)).matrix[0, 0] for limit in (0.15, 0.2, 0.3)]
    assert asked[0] > asked[1] > asked[2] == view.matrix[0, 0]


def test_where_no_std_limits_what_is_known_the_hull_does(fisheye):
    camera = with_corners_up_to(fisheye, 40.0)
    view = named_view(camera, ViewOptions(size=(400, 300)))
    corners = camera.domain.hull.vertices
    assert seen_share(camera, view, corners) == 1.0
    top, bottom = directions_of(view, [[199.5, 0.0], [199.5, 299.0]])
    assert np.rad2deg(np.arccos(top @ bottom)) == pytest.approx(80.0, abs=0.5)


@pytest.mark.parametrize(("corners", "reach"), [(50.0, 65.0), (67.0, 67.0), (69.9, 69.9), (71.0, 65.0), (85.0, 65.0)])
def test_a_flat_view_goes_to_65_degrees_and_to_70_for_the_sake_of_all_corners(fisheye, corners, reach):
    camera = with_corners_up_to(fisheye, corners, max_std=10.0)
    view = named_view(camera, ViewOptions(size=(300, 300)))
    left, right = directions_of(view, [[0.0, 149.5], [299.0, 149.5]])
    assert np.rad2deg(np.arccos(left @ right)) == pytest.approx(2.0 * reach, abs=0.7)
    on_image = np.clip(camera.domain.hull.vertices, 0.0, np.array(SIZE) - 1.0)
    assert (seen_share(camera, view, on_image) == 1.0) == (corners <= 70.0)


def test_the_share_outside_a_view(fisheye):
    view = named_view(fisheye, ViewOptions(size=(400, 300), fov=90.0))
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    uv = np.column_stack([u.ravel(), v.ravel()]).astype(float)
    assert share_outside(fisheye, view, None) == pytest.approx(1.0 - seen_share(fisheye, view, uv), abs=0.005)
    assert share_outside(fisheye, named_view(fisheye, ViewOptions("equirectangular", size=(400, 300))), None) == 0.0


def test_nothing_outside_the_image_may_be_believed(fisheye):
    uv = np.array([[5000.0, 5000.0], [-1.0, 0.0], [np.nan, 3.0], [np.inf, 0.0], [0.0, 479.6], [3.0, 3.0]])
    for limit in (None, 10.0):
        np.testing.assert_array_equal(valid_pixels(fisheye, uv, limit), [False] * 5 + [True])


@pytest.mark.parametrize("name", ["camera", "cylindrical", "equirectangular"])
@pytest.mark.parametrize("size", [(320, 200), (150, 300)])
def test_only_valid_pixels_are_kept_and_as_many_as_there_are(fisheye, name, size):
    narrow = named_view(fisheye, ViewOptions(name, size=size, keep="valid", max_std=0.3))
    assert rectification_map(fisheye, narrow, max_std=0.3).valid.all()
    grown = np.diag([0.95, 0.95, 1.0]) @ narrow.matrix
    grown[:2, 2] += 0.05 * (np.array(size) - 1) / 2.0
    wider = View(grown, narrow.rotation, size, narrow.surface)
    assert not rectification_map(fisheye, wider, max_std=0.3).valid.all()


def test_a_picture_without_black_needs_something_to_show(fisheye):
    with pytest.raises(CalibrationError, match="no part of this view is free of black"):
        named_view(fisheye, ViewOptions(size=(300, 2), keep="valid"))


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("camera", {"fov": 175.0}, "at most 170; for more, use the view 'cylindrical'"),
        ("equirectangular", {"fov": 361.0}, "at most 360"),
        ("camera", {"fov": 60.0, "keep": "valid"}, "cannot both be given"),
        ("camera", {"keep": "most"}, "unknown value 'most' of keep: choose one of all, valid"),
        ("cube-up", {"fov": 60.0}, "90 degrees wide; give neither"),
    ],
)
def test_what_is_no_view_is_refused(fisheye, name, options, message):
    with pytest.raises(InputError, match=message):
        named_view(fisheye, ViewOptions(name, **options))


def test_a_face_that_is_not_square_is_refused():
    with pytest.raises(InputError, match="200x100 was requested; give a square size"):
        ViewOptions("cube-up", size=(200, 100))


def largest_by_trying(mask, proportion):
    """The width of the largest rectangle of true pixels, by trying all."""
    rows, columns = mask.shape
    for width in range(columns, 0, -1):
        height = int(np.ceil(width / proportion))
        for top in range(rows - height + 1):
            for left in range(columns - width + 1):
                if mask[top : top + height, left : left + width].all():
                    return width
    return 0


@given(st.integers(0, 1000), st.sampled_from([0.5, 1.0, 1.6]))
def test_the_largest_rectangle_is_the_largest(seed, proportion):
    rng = np.random.default_rng(seed)
    mask = np.ones((14, 18), dtype=bool)
    mask[rng.integers(0, 14, 4), rng.integers(0, 18, 4)] = False
    found, width = largest_rectangle(mask, proportion), largest_by_trying(mask, proportion)
    if found is None:
        assert min(width, np.ceil(width / proportion)) < 5
        return
    assert found.right - found.left + 3 == width
    assert mask[int(found.top) - 1 : int(found.bottom) + 2, int(found.left) - 1 : int(found.right) + 2].all()


def horizon_picture():
    """Bright above the horizon as the fisheye sees it."""
    y = np.arange(SIZE[1], dtype=float)[:, None]
    return np.where(y < MIDDLE[1], 220, 40).astype(np.uint8) * np.ones((1, SIZE[0]), np.uint8)


def test_pictures_show_what_views_say(fisheye):
    """Turned up by 10 degrees and with 90 degrees over 200 px, the horizon lies 100 tan(10 degrees) px lower."""
    straighten = Straightener(fisheye, ViewOptions(size=(200, 200), turn=(0.0, 10.0, 0.0), fov=90.0))
    middle = straighten(horizon_picture())[:, 100].astype(int)
    assert np.argmax(middle < 130) == pytest.approx(99.5 + 100.0 * np.tan(np.deg2rad(10.0)), abs=1.0)


def test_a_splat_leaves_no_holes_where_a_view_magnifies(fisheye):
    picture = np.full((SIZE[1], SIZE[0], 3), 200, np.uint8)
    splatted = Straightener(fisheye, ViewOptions(size=(400, 300), fov=25.0), method="splat")(picture)
    assert (splatted == 200).all()


@pytest.mark.parametrize("channels", [(), (3,)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_a_splat_is_made_as_the_paper_says(fisheye, dtype, channels):
    """Every pixel goes to its rounded place; a hole is the median of those of its eight neighbours that are there."""
    picture = np.random.default_rng(0).integers(0, 255, (SIZE[1], SIZE[0], *channels)).astype(dtype)
    straighten = Straightener(fisheye, ViewOptions(size=(400, 300), fov=100.0), method="splat")
    placed = np.full((302, 402, *channels), np.nan)
    v, u = (grid.ravel() for grid in np.mgrid[0 : SIZE[1], 0 : SIZE[0]])
    directions = fisheye.chart.directions(fisheye.plane_map.value(np.column_stack([u, v]).astype(float)))
    x, y = np.rint(np.nan_to_num(straighten.view.project(directions), nan=-1.0)).astype(int).T
    seen = (x >= 0) & (y >= 0) & (x < 400) & (y < 300)
    placed[y[seen] + 1, x[seen] + 1] = picture[v[seen], u[seen]]
    holes = np.argwhere(np.isnan(placed.reshape(302, 402, -1)[1:-1, 1:-1, 0])) + 1
    expected = placed.copy()
    for row, column in holes:
        around = placed[row - 1 : row + 2, column - 1 : column + 2].reshape(9, *channels)
        expected[row, column] = np.nanmedian(around, axis=0) if np.isfinite(around).any() else np.nan
    at_once = np.isfinite(expected[1:-1, 1:-1])
    assert len(holes) > 1000
    assert at_once.mean() > 0.99
    agree = straighten(picture)[at_once] == expected[1:-1, 1:-1][at_once].astype(dtype)
    assert agree.mean() > 0.999  # but for rays halfway between pixels


def test_a_splat_grows_no_streaks(fisheye):
    picture = np.where(np.indices((SIZE[1], SIZE[0])).sum(axis=0) % 40 < 20, 40, 220).astype(np.uint8)
    splatted, remapped = (
        Straightener(fisheye, ViewOptions(size=(400, 300), fov=25.0), method=method)(picture).astype(float)
        for method in ("splat", "remap")
    )
    assert (np.abs(splatted - remapped) > 90).mean() < 0.06  # a px of the image, here four wide, along the edges


def test_a_view_turned_from_all_that_is_seen_is_black(fisheye):
    view = named_view(fisheye, ViewOptions("cube-back"))
    made = rectification_map(fisheye, view)
    assert not made.valid.any()
    assert not remap(np.full((SIZE[1], SIZE[0]), 255, np.uint8), made).any()


def test_only_flat_views_are_exported_as_pinhole_cameras(fisheye):
    face = pinhole_export(fisheye, ViewOptions("cube-right", size=(60, 60)))
    assert face.intrinsics == pytest.approx((30.0, 30.0, 29.5, 29.5))
    with pytest.raises(InputError, match="'cylindrical' is not a pinhole camera"):
        pinhole_export(fisheye, ViewOptions("cylindrical"))
