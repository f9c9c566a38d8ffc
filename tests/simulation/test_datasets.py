"""The six data sets are the paper's in number and size, possible in space, and the same every time."""

import dataclasses
import functools

import numpy as np
import pytest

from pinholify.board import lattice
from pinholify.geometry import Pose, apply_homography
from pinholify.simulation.datasets import DATASETS, Dataset, mirrored, reduced
from pinholify.simulation.demo import DEMO, street
from pinholify.simulation.lenses import LENSES, Resized

PAPER = {  # boards, corners, image: Table 1
    "unity-pinhole": (30, "15x9", (3840, 2160)),
    "unity-barrel": (30, "15x9", (3840, 2160)),
    "unity-pincushion": (30, "15x9", (3840, 2160)),
    "webcam": (11, "15x9", (2560, 1440)),
    "webcam-telelens": (17, "14x9", (2560, 1440)),
    "mirror": (26, "14x9", (971, 871)),
}


def test_the_table_is_the_papers() -> None:
    assert {d.name: (d.views, d.board.spec, d.lens.size) for d in DATASETS.values()} == PAPER
    assert list(DATASETS) == list(PAPER)


ALL = {**DATASETS, "demo": DEMO}


@functools.cache
def poses_of(name: str) -> tuple[Pose, ...]:
    return ALL[name].poses()


@pytest.fixture(params=ALL, scope="module")
def dataset(request: pytest.FixtureRequest) -> Dataset:
    return ALL[request.param]


def test_every_view_shows_its_whole_board(dataset: Dataset) -> None:
    poses = poses_of(dataset.name)
    assert len(poses) == dataset.views
    for pose in poses:
        uv = dataset.lens.project(pose.apply(lattice(dataset.board)))
        assert ((uv > 5) & (uv < np.array(dataset.lens.size) - 6)).all()


def test_the_first_board_fills_the_frame(dataset: Dataset) -> None:
    uv = dataset.lens.project(poses_of(dataset.name)[0].apply(lattice(dataset.board)))
    share = np.ptp(uv, axis=0) / dataset.lens.size
    assert share.max() > 0.8
    assert share.min() > 0.7


def test_boards_are_not_parallel(dataset: Dataset) -> None:
    normals = np.array([pose.rotation[:, 2] for pose in poses_of(dataset.name)])
    assert np.linalg.svd(normals - normals.mean(axis=0), compute_uv=False)[1] > 0.5


def test_every_choice_has_a_reason(dataset: Dataset) -> None:
    sensor = dataset.sensor
    used = {"lens": True, "jpeg": sensor.jpeg_quality, "noise": sensor.read_noise, "blur": sensor.blur,
            "vignetting": sensor.vignetting}
    assert {choice for choice, value in used.items() if value} <= set(dataset.reasons)
    assert all(dataset.reasons.values())


def test_the_unity_sets_show_the_same_boards() -> None:
    sets = [poses_of(name) for name in ("unity-pinhole", "unity-barrel", "unity-pincushion")]
    for first, *others in zip(*sets, strict=True):
        assert all((first.rotation == pose.rotation).all() for pose in others)
        assert all((first.translation == pose.translation).all() for pose in others)


def test_only_the_mirror_reverses() -> None:
    assert [name for name, d in DATASETS.items() if mirrored(d.lens)] == ["mirror"]
    assert [name for name, lens in LENSES.items() if mirrored(lens)] == ["mirror", "fisheye-mirror"]


def test_no_board_stands_in_the_mirror_or_between_it_and_the_camera() -> None:
    """The way from the camera to the mirror crosses no sheet, and every sheet lies before the mirror."""
    mirror, board = DATASETS["mirror"].lens, DATASETS["mirror"].board
    grid = np.stack(np.meshgrid(np.linspace(0, 970, 30), np.linspace(0, 870, 30)), axis=-1).reshape(-1, 2)
    hits, _ = mirror.unproject(grid)
    hits = hits[np.isfinite(hits).all(axis=1)]
    low, high = np.array([-1.7, -1.7]), np.array([board.columns + 0.7, board.rows + 0.7])
    for pose in poses_of("mirror"):
        camera, ends = -pose.translation @ pose.rotation, (hits - pose.translation) @ pose.rotation
        share = camera[2] / (camera[2] - ends[:, 2])
        crossing = camera[:2] + share[:, None] * (ends[:, :2] - camera[:2])
        on_sheet = ((crossing > low) & (crossing < high)).all(axis=1)
        assert not (on_sheet & (share > 0) & (share <= 1)).any()


def test_the_virtual_camera_maps_every_board_by_a_homography_of_its_k() -> None:
    """Seen from the optical centre, the first board's plane at z = f holds each board as K [r1 r2 t] does."""
    dataset = DATASETS["unity-barrel"]
    f, uc, vc = dataset.truth().virtual_camera
    first, other = poses_of(dataset.name)[:2]
    k = np.array([[f, 0, uc], [0, f, vc], [0, 0, 1]])
    turn, shift = first.rotation.T @ other.rotation, first.rotation.T @ other.translation
    by_k = apply_homography(k @ np.column_stack([turn[:, :2], shift]), lattice(dataset.board))
    rays = dataset.lens.unproject(dataset.lens.project(other.apply(lattice(dataset.board)))).directions
    reach = (first.translation @ first.rotation[:, 2]) / (rays @ first.rotation[:, 2])
    on_first = (reach[:, None] * rays - first.translation) @ first.rotation
    assert np.abs(on_first[:, :2] - by_k).max() < 1e-9


def test_truth_covers_the_image(dataset: Dataset) -> None:
    truth = dataset.truth(9, 7)
    assert truth.pixels.shape == (63, 2)
    assert truth.pixels.max(axis=0).tolist() == [dataset.lens.size[0] - 1, dataset.lens.size[1] - 1]
    seen = np.isfinite(truth.directions).all(axis=1)
    assert seen.mean() > 0.9
    far = truth.origins + 20 * truth.directions
    assert np.abs(dataset.lens.project(far[seen]) - truth.pixels[seen]).max() < 1e-6
    assert (truth.virtual_camera is None) == (not truth.central) == (dataset.name == "mirror")


def small(dataset: Dataset) -> Dataset:
    return dataclasses.replace(reduced(dataset, 4), views=3)


def test_a_reduced_data_set_shows_the_same_scenes() -> None:
    whole, half = DATASETS["unity-barrel"], reduced(DATASETS["unity-barrel"], 2)
    assert half.lens.size == (1920, 1080)
    for a, b in zip(poses_of(whole.name), half.poses(), strict=True):
        assert np.allclose(a.translation, b.translation, atol=0.2)
        assert np.allclose(a.rotation, b.rotation, atol=0.02)


def test_photographs_come_from_the_seed_alone() -> None:
    first, again = (list(small(DEMO).photographs(2)) for _ in range(2))
    alone = next(small(DEMO).photographs(1))
    for a, b in zip(first, again, strict=True):
        assert (a.image == b.image).all()
        assert (a.corners == b.corners).all()
    assert (alone.image == first[0].image).all()
    other = next(dataclasses.replace(small(DEMO), seed=99).photographs(1))
    assert (other.image != alone.image).any()


def test_noise_comes_from_the_seed() -> None:
    noise = []
    for seed in (1, 2):
        noisy = dataclasses.replace(small(DEMO), seed=seed)
        quiet = dataclasses.replace(DEMO.sensor, read_noise=0.0, shot_noise=0.0)
        clean = dataclasses.replace(noisy, sensor=quiet)
        noise.append(next(noisy.photographs(1)).image.astype(int) - next(clean.photographs(1)).image)
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.05


def test_photographs_are_named_and_eight_bit() -> None:
    view = list(small(DEMO).photographs(2))[1]
    assert view.name == "demo-01"
    assert view.image.shape == (240, 320)
    assert view.image.dtype == np.uint8
    assert view.corners.shape == (135, 2)


def test_the_street_is_a_colour_photograph() -> None:
    image = street(Resized(DEMO.lens, (160, 120)))
    assert image.shape == (120, 160, 3)
    assert image.dtype == np.uint8
    brick, sky = image[40, 80].astype(int), image[2, 2].astype(int)
    assert sky[2] > sky[0] + 30
    assert image.std() > 30
    assert brick.max() < 250
