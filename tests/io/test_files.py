import errno
import io
import os
import stat

import pytest

from pinholify.errors import CornerTableError, InputError, OutputError
from pinholify.io.files import atomic_path, reading_text, source_name, writing_text


def test_a_finished_file_replaces_the_old_one_and_leaves_nothing_beside(tmp_path):
    target = tmp_path / "camera.npz"
    target.write_text("old")
    os.link(target, tmp_path / "reader")  # Who has the old file open keeps all of it.
    with atomic_path(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".npz"
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert (tmp_path / "reader").read_text() == "old"
    assert sorted(os.listdir(tmp_path)) == ["camera.npz", "reader"]


def write_half(path, failure):
    with atomic_path(path) as temporary:
        temporary.write_text("half")
        raise failure


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt])
def test_a_failure_keeps_the_old_file_and_leaves_nothing_beside(tmp_path, failure):
    target = tmp_path / "camera.npz"
    target.write_text("old")
    with pytest.raises(failure):
        write_half(target, failure)
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["camera.npz"]


def test_permissions_follow_the_umask(tmp_path):
    before = os.umask(0o027)
    try:
        with atomic_path(tmp_path / "out") as temporary:
            temporary.write_text("text")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o640


def test_links_are_followed(tmp_path):
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to("real")
    with atomic_path(tmp_path / "link") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def place(tmp_path, kind):
    (tmp_path / "file").write_text("kept")
    return {
        "missing folder": tmp_path / "none" / "out.png",
        "file as folder": tmp_path / "file" / "out.png",
        "folder": tmp_path,
        "pipe": tmp_path / "pipe",
        "long name": tmp_path / ("x" * 300),
    }[kind]


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("missing folder", "does not exist"),
        ("file as folder", "not a folder"),
        ("folder", "it is a folder"),
        ("pipe", "a device or a pipe"),
        ("long name", "too long"),
    ],
)
def test_places_that_cannot_be_written_are_refused_before_work_starts(tmp_path, kind, words):
    os.mkfifo(tmp_path / "pipe")
    target = place(tmp_path, kind)
    before = sorted(os.listdir(tmp_path))
    with pytest.raises(OutputError, match=words) as caught, atomic_path(target):
        pytest.fail("the block ran")
    assert str(target) in str(caught.value)
    assert sorted(os.listdir(tmp_path)) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(OutputError, match="permission is denied"), atomic_path(tmp_path / "out"):
        pytest.fail("the block ran")


@pytest.mark.parametrize("code", [errno.EACCES, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EIO])
@pytest.mark.parametrize("moment", ["open", "write"])
def test_failures_of_the_system_become_one_sentence(tmp_path, monkeypatch, code, moment):
    words = {
        errno.EACCES: "permission is denied",
        errno.EROFS: "read-only",
        errno.ENOSPC: "disk is full",
        errno.EDQUOT: "quota",
        errno.EIO: os.strerror(errno.EIO),
    }[code]

    def fail(*_, **__):
        raise OSError(code, os.strerror(code))

    if moment == "open":
        monkeypatch.setattr(os, "open", fail)
    with pytest.raises(OutputError, match=words) as caught, atomic_path(tmp_path / "out"):
        fail()
    assert str(caught.value).startswith(f"'{tmp_path / 'out'}' cannot be written: ")
    assert os.listdir(tmp_path) == []


def test_a_file_that_is_protected_is_not_replaced(tmp_path, monkeypatch):
    (tmp_path / "out").write_text("kept")
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(OutputError, match="permission is denied"), atomic_path(tmp_path / "out"):
        pytest.fail("the block ran")
    assert (tmp_path / "out").read_text() == "kept"


def test_text_goes_to_streams_and_paths_alike(tmp_path):
    stream = io.StringIO()
    for target in (stream, tmp_path / "text"):
        with writing_text(target) as out:
            out.write("grüße\n")
    assert stream.getvalue() == "grüße\n"
    assert (tmp_path / "text").read_bytes() == "grüße\n".encode()


def test_text_comes_from_streams_and_paths_alike(tmp_path):
    (tmp_path / "text").write_bytes(b"\xef\xbb\xbfa\r\nb\n")
    with reading_text(tmp_path / "text") as stream:
        assert list(stream) == ["a\n", "b\n"]
    with reading_text(io.StringIO("a\n")) as stream:
        assert list(stream) == ["a\n"]
    assert source_name(io.StringIO()) == "standard input"


@pytest.mark.parametrize(("name", "words"), [("none", "no file"), ("", "folder"), ("bytes", "not text")])
def test_what_cannot_be_read_is_said_in_the_class_asked_for(tmp_path, name, words):
    (tmp_path / "bytes").write_bytes(b"\x89PNG\r\n\x1a\n\xff")
    source = reading_text(tmp_path / name, CornerTableError)
    with pytest.raises(CornerTableError, match=words), source as stream:
        stream.read()


def test_no_permission_to_read_is_said(tmp_path, monkeypatch):
    def refuse(*_, **__):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr("builtins.open", refuse)
    with pytest.raises(InputError, match="cannot be read"), reading_text(tmp_path / "secret"):
        pytest.fail("the block ran")
