"""``pinholify reproduce`` refuses in one sentence before any work, and prints what it was given."""

import builtins
import importlib.util

import pytest

from pinholify.cli import main


def status(capsys, *words):
    """Exit status, standard output and standard error of the command line."""
    try:
        code = main(["reproduce", *map(str, words)])
    except SystemExit as end:
        code = end.code
    return code, *capsys.readouterr()


def test_without_matplotlib_one_sentence_says_what_to_install(tmp_path, capsys, monkeypatch):
    find_spec = importlib.util.find_spec
    hidden = {"matplotlib": lambda *_: None}
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: hidden.get(name, find_spec)(name, *a))
    monkeypatch.setattr("pinholify.reproduction.run.make_folder", lambda _: pytest.fail("work before the check"))
    code, out, err = status(capsys, "-o", tmp_path / "new")
    assert (code, out) == (1, "")
    assert err.count("\n") == 1
    assert "pip install 'pinholify[figures]'" in err
    assert not (tmp_path / "new").exists()


def test_a_folder_that_holds_other_files_is_refused(tmp_path, capsys):
    (tmp_path / "thesis.txt").write_text("mine")
    code, _, err = status(capsys, "-o", tmp_path)
    assert code == 1
    assert "--force" in err
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_folder_that_cannot_be_made_is_refused(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    code, _, err = status(capsys, "-o", tmp_path / "file" / "below")
    assert code == 1
    assert "cannot be created" in err


def test_help_loads_no_figures(capsys, monkeypatch):
    load = builtins.__import__

    def refuse(name, *rest):
        assert not name.startswith(("matplotlib", "pinholify.reproduction"))
        return load(name, *rest)

    monkeypatch.setattr(builtins, "__import__", refuse)
    assert "--quick" in status(capsys, "--help")[1]
