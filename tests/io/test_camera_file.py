"""Camera files: the same camera back, and nothing but CameraFileError from anything else."""

from __future__ import annotations

import contextlib
import io
import json
import pickle
import zipfile
from dataclasses import fields, is_dataclass, make_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pinholify.board import Checkerboard, size
from pinholify.calibration.result import Calibration
from pinholify.camera import Domain, VirtualCamera
from pinholify.charts import Intrinsics, PlaneChart
from pinholify.corners import Corners, CornerSet, not_found
from pinholify.errors import CameraFileError, OutputError
from pinholify.geometry import convex_hull
from pinholify.gp.fitting import fit_map
from pinholify.gp.kernels import KERNELS
from pinholify.gp.trends import TRENDS
from pinholify.io import camera_file
from pinholify.io.camera_file import HOMES, is_camera_file, read_camera, type_named, write_camera
from pinholify.pipeline import calibrate
from pinholify.refinement.trends import FAMILIES
from pinholify.simulation.lenses import BrownConrady
from pinholify.simulation.views import board_poses, true_corners

BOARD, SIZE = Checkerboard(6, 5), (640, 480)


def corner_set() -> CornerSet:
    lens = BrownConrady(SIZE, (420.0, 420.0), (6.0, -4.0), (-0.15, 0.02, 0.0))
    rng = np.random.default_rng(0)
    views = []
    for i, pose in enumerate(board_poses((lens,), BOARD, 7, seed=5)):
        uv = true_corners(lens, BOARD, pose) + rng.normal(0, 0.1, (size(BOARD), 2))
        weights = rng.uniform(0.5, 1.0, len(uv)) if i == 2 else np.ones(len(uv))
        views.append(Corners(f"ü{i}.png", np.arange(len(uv)), uv, weights, "", i == 3, i == 4))
    return CornerSet(BOARD, SIZE, (*views, not_found("none.png", "no board")))


CORNERS = corner_set()
PIXELS = np.array([[320.0, 240.0], [200.0, 150.0], [420.0, 330.0], [10.0, 470.0]])


def calibration_of(kernel: str = "se", trend: str = "lens:1") -> Calibration:
    """A calibration around a map of the given kind; K and the rest are made up."""
    view = CORNERS.views[0]
    fitted = fit_map(view.uv, view.lattice(BOARD), kernel=kernel, trend=trend)
    intrinsics = Intrinsics(4.3, 2.5, 2.0)
    hull = convex_hull(view.uv)
    camera = VirtualCamera(fitted.map, PlaneChart(intrinsics), Domain(hull), SIZE, fitted.noise)
    return Calibration(
        camera,
        CORNERS,
        method="one-image",
        kernel=kernel,
        trend=fitted.trend,
        reference=view.name,
        intrinsics_std=np.array([0.1, np.nan, np.inf]),
        square_mm=25.0,
        closed_form=Intrinsics(4.2, 2.5, 2.1),
        details={"numbers": [1.0, float("nan")], "texts": {"a": None, "b": True}},
    )


def assert_same_camera(read: Calibration, written: Calibration) -> None:
    for name in ("directions", "std_px", "origins"):
        assert np.array_equal(
            getattr(read.camera.to_rays(PIXELS), name), getattr(written.camera.to_rays(PIXELS), name), equal_nan=True
        )
    xy = written.camera.virtual_points(PIXELS)
    assert np.array_equal(read.camera.from_virtual(xy).points, written.camera.from_virtual(xy).points, equal_nan=True)
    assert np.array_equal(read.camera.inside(PIXELS), written.camera.inside(PIXELS))


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[bytes, Calibration]:
    path = tmp_path_factory.mktemp("camera") / "camera.npz"
    calibration = calibration_of()
    write_camera(path, calibration)
    return path.read_bytes(), calibration


@pytest.mark.parametrize("trend", ["constant", "homography", "lens:2", "polynomial:3"])
@pytest.mark.parametrize("kernel", list(KERNELS))
def test_every_map_comes_back(tmp_path, kernel, trend):
    calibration = calibration_of(kernel, trend)
    write_camera(tmp_path / "camera.npz", calibration)
    assert_same_camera(read_camera(tmp_path / "camera.npz"), calibration)


@pytest.mark.parametrize("trend", ["plane:1", "angle:1", "plane-d:1", "polynomial:3"])
def test_every_joint_map_comes_back(tmp_path, trend):
    calibration = calibrate(CORNERS, method="joint", trend=trend)
    write_camera(tmp_path / "camera.npz", calibration)
    read = read_camera(tmp_path / "camera.npz")
    assert read.method == "joint"
    assert_same_camera(read, calibration)


def test_all_kernels_and_trends_may_be_kept():
    built = [make() for make in KERNELS.values()]
    built += [build(orders[0]) for build, orders in TRENDS.values()]
    searches = [search for family in FAMILIES.values() for search in family(None)]
    built += [trend for search in searches for trend in (search.general, *search.within)]
    built += [t.chart for t in built if hasattr(t, "chart")]
    for value in built:
        assert type_named(type(value).__name__) is type(value)


def test_all_types_are_dataclasses_whose_fields_are_their_arguments():
    for kind in map(type_named, HOMES):
        assert is_dataclass(kind)
        assert all(field.init for field in fields(kind))


def test_everything_else_comes_back(tmp_path, written):
    (tmp_path / "c.npz").write_bytes(written[0])
    read, calibration = read_camera(tmp_path / "c.npz"), written[1]
    for name in ("method", "kernel", "trend", "reference", "square_mm", "closed_form"):
        assert getattr(read, name) == getattr(calibration, name)
    assert np.array_equal(read.intrinsics_std, calibration.intrinsics_std, equal_nan=True)
    assert np.array_equal(read.board_points, calibration.board_points)
    assert read.details["texts"] == {"a": None, "b": True}
    assert read.camera.mirrored is False
    assert read.corner_set.board == BOARD
    assert read.corner_set.image_size == SIZE
    for one, other in zip(read.corner_set.views, CORNERS.views, strict=True):
        assert (one.name, one.reason) == (other.name, other.reason)
        assert (one.orientation_assumed, one.ambiguous_offset) == (other.orientation_assumed, other.ambiguous_offset)
        for name in ("ids", "uv", "weights"):
            assert np.array_equal(getattr(one, name), getattr(other, name))


def test_header_is_readable_by_anybody(tmp_path, written):
    (tmp_path / "c.npz").write_bytes(written[0])
    with np.load(tmp_path / "c.npz", allow_pickle=False) as archive:
        header = json.loads(archive["header"].tobytes())
        assert all(archive[key].dtype.kind in "fiu" for key in archive.files)
    assert header["format"] == "pinholify-camera"
    assert header["format_version"] == 3
    assert header["units"] == {"image": "px, integer = pixel centre", "virtual": "squares", "square_mm": 25.0}
    assert header["board"] == "6x5"
    assert header["handedness"] == "right-handed as seen in the image"
    assert header["provenance"]["software"].startswith("pinholify ")
    assert header["provenance"]["images"] == [view.name for view in CORNERS.views]
    assert header["provenance"]["reference"] == "ü0.png"


# --- what is no camera ---------------------------------------------------------------------------------------


def changed(data: bytes, change) -> bytes:
    """The camera file ``data`` after ``change`` of its header (a dictionary) and arrays."""
    with np.load(io.BytesIO(data)) as archive:
        arrays = dict(archive)
    header = json.loads(arrays.pop("header").tobytes())
    change(header, arrays)
    file = io.BytesIO()
    np.savez(file, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return file.getvalue()


def set_type(header, arrays):
    header["calibration"]["fields"]["camera"]["type"] = "system"


def set_builtin(header, arrays):
    header["calibration"] = {"type": "Intrinsics", "fields": {"f": 1.0, "uc": 0.0, "vc": 0.0}}


def drop_array(header, arrays):
    arrays.pop("calibration.camera.domain.hull.vertices")


def reshape_array(header, arrays):
    arrays["calibration.camera.domain.hull.vertices"] = np.zeros((3, 3))


def drop_field(header, arrays):
    header["calibration"]["fields"]["camera"]["fields"].pop("plane_map")


def add_field(header, arrays):
    header["calibration"]["fields"]["extra"] = 1


def swap_part(header, arrays):
    camera = header["calibration"]["fields"]["camera"]["fields"]
    camera["plane_map"] = camera["chart"]


def shorten_counts(header, arrays):
    header["calibration"]["fields"]["corner_set"]["corners"]["counts"][0] = 3


def nest_deeply(header, arrays):
    value = header["calibration"]
    for _ in range(400):
        value = {"list": [value]}
    header["calibration"] = value


def other_unit(header, arrays):
    header["units"]["virtual"] = "px"


def empty_header(header, arrays):
    header.pop("calibration")


CHANGES = [set_type, set_builtin, drop_array, reshape_array, drop_field, add_field, swap_part, shorten_counts,
           nest_deeply, other_unit, empty_header]  # fmt: skip


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_changed_file_is_refused(tmp_path, written, change):
    path = tmp_path / "c.npz"
    path.write_bytes(changed(written[0], lambda header, arrays: None))
    assert read_camera(path).method == "one-image"
    path.write_bytes(changed(written[0], change))
    with pytest.raises(CameraFileError, match=r"is damaged .* calibrate again or fetch the file again"):
        read_camera(path)


@pytest.mark.parametrize(
    ("version", "remedy"),
    [(2, "calibrate again"), (4, "upgrade pinholify"), ("3", "upgrade pinholify"), (None, "upgrade pinholify")],
)
def test_other_versions_are_refused(tmp_path, written, version, remedy):
    path = tmp_path / "c.npz"
    path.write_bytes(changed(written[0], lambda header, arrays: header.update(format_version=version)))
    with pytest.raises(CameraFileError, match=f"format {version} .* reads 3: {remedy}"):
        read_camera(path)
    assert is_camera_file(path)


def test_other_format_is_refused(tmp_path, written):
    path = tmp_path / "c.npz"
    path.write_bytes(changed(written[0], lambda header, arrays: header.update(format="something")))
    with pytest.raises(CameraFileError, match="is not a pinholify camera"):
        read_camera(path)
    assert not is_camera_file(path)


class Harm:
    """Would leave a mark, were it unpickled."""

    happened = False

    def __reduce__(self):
        return setattr, (Harm, "happened", True)


def test_nothing_is_unpickled(tmp_path, written):
    path = tmp_path / "c.npz"

    def with_object(header, arrays):
        arrays["calibration.intrinsics_std"] = np.array([Harm()], dtype=object)

    for data in (pickle.dumps(Harm()), changed(written[0], with_object)):
        path.write_bytes(data)
        with pytest.raises(CameraFileError):
            read_camera(path)
    assert Harm.happened is False


def test_archive_that_would_fill_the_memory(tmp_path, written, monkeypatch):
    path = tmp_path / "c.npz"
    path.write_bytes(written[0])
    with zipfile.ZipFile(path) as archive:
        total = sum(entry.file_size for entry in archive.infolist())
    monkeypatch.setattr(camera_file, "MAX_BYTES", total)
    assert read_camera(path)
    monkeypatch.setattr(camera_file, "MAX_BYTES", total - 1)
    with pytest.raises(CameraFileError, match="would unpack to more than"):
        read_camera(path)


@settings(max_examples=150, deadline=None)
@given(data=st.data())
def test_damage_is_seen(tmp_path_factory, written, data):
    """Flipped bytes and cut ends: refused, or without effect."""
    whole = bytearray(written[0])
    if data.draw(st.booleans()):
        del whole[data.draw(st.integers(0, len(whole) - 1)) :]
    for _ in range(data.draw(st.integers(0, 3)) if whole else 0):
        whole[data.draw(st.integers(0, len(whole) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.npz"
    path.write_bytes(whole)
    with contextlib.suppress(CameraFileError):
        assert_same_camera(read_camera(path), written[1])


@settings(max_examples=60, deadline=None)
@given(data=st.binary(max_size=400))
def test_any_bytes_are_refused(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.npz"
    path.write_bytes(data)
    with pytest.raises(CameraFileError):
        read_camera(path)
    assert not is_camera_file(path)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(CameraFileError, match="there is no camera file"):
        read_camera(tmp_path / "no.npz")
    with pytest.raises(CameraFileError, match="is a folder"):
        read_camera(tmp_path)


def test_failed_writing_leaves_the_old_file(tmp_path, written, monkeypatch):
    path = tmp_path / "c.npz"
    path.write_bytes(written[0])

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", full)
    with pytest.raises(OutputError, match="the disk is full"):
        write_camera(path, written[1])
    assert path.read_bytes() == written[0]
    assert list(tmp_path.iterdir()) == [path]


def test_unknown_kind_is_a_mistake_of_ours(tmp_path, written):
    calibration = written[1]
    calibration.details["thing"] = object()
    try:
        with pytest.raises(TypeError, match="object cannot be kept in a camera file; add it to HOMES"):
            write_camera(tmp_path / "c.npz", calibration)
    finally:
        del calibration.details["thing"]


def test_a_type_that_only_has_the_name_of_another_is_not_kept_as_that(tmp_path, written):
    calibration = written[1]
    namesake = make_dataclass("Intrinsics", ["f", "uc", "vc"])(1.0, 2.0, 3.0)
    with pytest.raises(TypeError, match=r"the Intrinsics of .* cannot be kept: HOMES has another of this name"):
        write_camera(tmp_path / "c.npz", replace(calibration, closed_form=namesake))
    assert not (tmp_path / "c.npz").exists()
