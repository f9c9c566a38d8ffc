"""Bytes at paths and URLs alike."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from pinholify.errors import ImageError, InputError, OutputError
from pinholify.io import places
from pinholify.io.images import encode_image

fsspec = pytest.importorskip("fsspec", reason="needs the extra 'cluster'")


@pytest.fixture(params=["path", "memory", "file"])
def folder(request, tmp_path):
    """A new folder of each kind."""
    if request.param == "memory":
        yield "memory://batch/in"
        fsspec.filesystem("memory").store.clear()
    else:
        (tmp_path / "in").mkdir()
        yield str(tmp_path / "in") if request.param == "path" else f"file://{tmp_path}/in"


def test_bytes_come_back(folder):
    place = places.inside(folder, "a.bin")
    assert places.beginnings([place], 3) == [None]
    for content in (b"first", b"second"):
        places.write_bytes(place, content)
        assert places.read_bytes(place) == content
    missing = places.inside(folder, "b.bin")
    assert places.beginnings([place, missing], 3) == [b"sec", None]
    assert places.sizes([place, missing]) == [6, None]
    assert places.name_of(place) == "a.bin"


def test_a_folder_stands_for_its_images_in_natural_order(folder):
    for name in ("10.png", "2.JPG", "notes.txt"):
        places.write_bytes(places.inside(folder, name), b"x")
    found = places.image_places([folder, places.inside(folder, "other")])
    assert list(map(places.name_of, found)) == ["2.JPG", "10.png", "other"]
    assert [places.read_bytes(place) for place in found[:2]] == [b"x", b"x"]


def test_a_folder_without_images(folder):
    places.write_bytes(places.inside(folder, "notes.txt"), b"x")
    with pytest.raises(ImageError, match="holds no images"):
        places.image_places([folder])


def test_what_is_missing_is_said(folder):
    with pytest.raises(ImageError, match=r"no such file|no file"):
        places.read_bytes(places.inside(folder, "none.png"))


@pytest.mark.parametrize("scheme", ["memory", "file"])
def test_a_write_that_fails_leaves_what_was_there(scheme, tmp_path, monkeypatch):
    place = f"{scheme}://{tmp_path}/a.bin"
    places.write_bytes(place, b"old")
    files = fsspec.filesystem(scheme)

    def broken(*_, **__):
        raise OSError("the network is down")

    monkeypatch.setattr(type(files), "mv", broken)
    with pytest.raises(OutputError, match="cannot be written: the network is down"):
        places.write_bytes(place, b"new")
    assert places.read_bytes(place) == b"old"
    assert len(files.ls(str(tmp_path))) == 1
    files.rm(str(tmp_path), recursive=True)


def test_schemes_that_cannot_be_reached(monkeypatch):
    with pytest.raises(InputError, match="'nothing://a' cannot be reached"):
        places.read_bytes("nothing://a")
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(InputError, match=r"pip install 'pinholify\[cluster\]'"):
        places.read_bytes("memory://a")


def test_paths_need_no_extra(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "fsspec", None)
    place = str(tmp_path / "a.png")
    places.write_bytes(place, encode_image(np.zeros((4, 4), np.uint8), place))
    assert places.image_places([str(tmp_path)]) == [place]
    assert places.beginnings([place], 4) == [b"\x89PNG"]


def test_one_name_of_a_place(tmp_path, monkeypatch):
    (tmp_path / "link").symlink_to("a.png")
    monkeypatch.chdir(tmp_path)
    assert places.real("link") == str(tmp_path / "a.png")
    assert places.absolute("link") == str(tmp_path / "link")
    assert places.real("s3://b/../a") == places.absolute("s3://b/../a") == "s3://b/../a"
    assert Path(places.inside("out", "a.png")) == Path("out/a.png")
