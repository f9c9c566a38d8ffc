"""``pinholify detect``: a name that no corner table holds is refused before any work, and not where none is written."""

import json
import shutil


def test_a_blank_in_a_name_is_refused_at_once(run, refused, photographs, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(photographs / "small-00.png", "a b.png")
    shutil.copy(photographs / "small-01.png", "c.png")
    monkeypatch.setattr("pinholify.cli.detect_command.detect_with_progress", None)  # not come to
    for output in ("-", "out.vnl"):
        sentence = refused("detect", "c.png", "a b.png", "--board", "9x6", "-o", output)
        assert "'a b.png' is not allowed in a corner table" in sentence
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    found = json.loads(run("detect", "a b.png", "--board", "9x6", "--json").out)
    assert found["images"][0]["file"] == "a b.png"
