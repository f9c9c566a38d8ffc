"""Every format is whole, escapes what users name, and needs nothing from elsewhere."""

import dataclasses
import json
import re
from html.parser import HTMLParser
from itertools import pairwise

import numpy as np
import pytest

from pinholify.errors import InputError, OutputError
from pinholify.evaluation.summary import OpenCVScore
from pinholify.report.contents import make_report
from pinholify.report.formats import FORMATS, is_report, render, write_report
from pinholify.report.formats.md import escape
from pinholify.report.html.markup import Markup, element
from pinholify.report.maps import Certainty
from pinholify.report.narrative import sections
from pinholify.report.numerals import angle, number, percent, px, with_std
from pinholify.report.provenance import Provenance

VOID = {"meta", "link", "img", "input"}


class Page(HTMLParser):
    """What a page is made of."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.text = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def page(report):
    return Page(render(report, "html"))


def test_the_page_is_well_formed_and_its_names_are_unique(page):
    assert page.open == []
    ids = [attributes["id"] for _, attributes in page.elements if "id" in attributes]
    assert len(ids) == len(set(ids))
    targets = [a["href"].removeprefix("#") for a in page.all("a")]
    assert set(targets) <= set(ids)


def test_the_page_loads_nothing(page):
    for _, attributes in page.elements:
        for name in ("src", "href", "xlink:href", "srcset", "data"):
            assert re.match(r"(data:|#|$)", attributes.get(name) or ""), attributes
        assert "url(" not in (attributes.get("style") or "")
    assert not re.search(r"@import|url\(|fetch\(|XMLHttp|https?://", "".join(page.text))


def test_a_hostile_name_is_text(page, hostile):
    assert sum(hostile in text for text in page.text) >= 2
    assert len(page.all("script")) == 2
    assert all(set(a) <= {"type"} for a in page.all("script"))
    assert not any(name.startswith("on") for _, attributes in page.elements for name in attributes)


def test_the_scenes_data_cannot_end_its_element(report, hostile):
    text = render(report, "html")
    data = re.search(r'<script type="application/json">(.*?)</script>', text, flags=re.S)[1]
    assert "<" not in data
    scene = json.loads(data)
    assert hostile in scene["names"]
    assert len(scene["names"]) == len(scene["boards"])


def test_pictures_and_drawings_have_words(page):
    for attributes in page.all("img"):
        assert "alt" in attributes
    for attributes in page.all("svg"):
        assert attributes.get("aria-hidden") == "true" or attributes["aria-label"]
    for attributes in page.all("input") + page.all("canvas") + page.all("button"):
        assert attributes["aria-label"] if "aria-label" in attributes else attributes["aria-pressed"]
    for attributes in page.all("th"):
        assert attributes["scope"] in ("col", "row")


def test_headings_go_down_by_one_at_most(page):
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(b <= a + 1 for a, b in pairwise(levels))


def test_every_section_is_on_the_page_and_linked(page, report):
    keys = [section.key for section in sections(report)]
    assert len(keys) == 13
    assert [a["id"] for a in page.all("section")] == keys
    links = [a["href"] for a in page.all("a") if a["href"].startswith("#")]
    assert [f"#{key}" for key in keys] == links[1 : 1 + len(keys)]


def test_the_page_lists_the_reasons_of_the_verdict(report):
    parts = {"headline": "held-out error 1 px", "reasons": ("one: two", "three"), "next_board": "photograph more"}
    text = render(dataclasses.replace(report, overview=dataclasses.replace(report.overview, **parts)), "html")
    assert "<span>Held-out error 1 px.</span>" in text
    assert '<ul class="reasons"><li>One: two.</li><li>Three.</li><li>Photograph more.</li></ul>' in text


def test_without_photographs_the_page_says_so_and_draws_the_boards(bare_report):
    page = Page(render(bare_report, "html"))
    assert page.open == []
    assert not page.all("img")
    assert any("photographs were not available" in text for text in page.text)
    assert len([a for a in page.all("figure") if a.get("id", "").startswith("photograph-")]) == 10


@pytest.mark.parametrize("form", FORMATS)
def test_what_is_not_known_is_said_to_be_unknown(evaluation, verdict, report, form):
    calibration = dataclasses.replace(
        evaluation.calibration, intrinsics_std=np.full(3, np.nan), square_mm=None, details={"log_evidence": {}}
    )
    models = {"fisheye": OpenCVScore(None, None, None)}
    poorest = dataclasses.replace(evaluation, calibration=calibration, lines=None, pinholeness=None, opencv=models)
    told = make_report(poorest, verdict, Provenance("c.npz", "", "", ""))
    told = dataclasses.replace(told, certainty=Certainty((), (), 0.001, 0.002))
    text = render(told, form)
    assert not re.search(r"\b(nan|inf|NaN|Infinity)\b", text)
    if form == "html":
        assert Page(text).open == []
        assert "below 0.01 px" in text
        assert "± unknown" in text
        assert "need at least three boards" in text


def test_markdown_has_every_table_and_escapes_names(report, hostile):
    text = render(report, "md")
    assert text.startswith("<!-- pinholify-report")
    assert escape(hostile) in text
    assert hostile not in text
    assert "```python" in text
    for table in re.findall(r"(?:^\|.*\n)+", text, flags=re.M):
        cells = {len(re.findall(r"(?<!\\)\|", line)) for line in table.splitlines()}
        assert len(cells) == 1, table
    outside = re.sub(r"```.*?```", "", text, flags=re.S)
    assert not re.search(r"(?<!\\)<(?!!-- pinholify)", outside)


def test_json_holds_the_numbers_and_no_pictures(report, hostile):
    data = json.loads(render(report, "json"))
    assert (data["format"], data["format_version"]) == ("pinholify-report", 1)
    assert data["intrinsics"]["lengths"][0]["value"] == report.intrinsics.lengths[0].value
    assert data["boards"][1]["name"] == hostile
    assert data["boards"][-1]["rms_px"] is None
    assert "thumbnail" not in data["boards"][0]
    assert "frames" not in data


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_is_written_and_known_again(report, tmp_path, form):
    path = tmp_path / f"report.{form}"
    write_report(path, report, form)
    assert is_report(path)
    assert path.read_text(encoding="utf-8") == render(report, form)


def test_a_name_that_is_no_text_is_still_written(report, tmp_path):
    provenance = dataclasses.replace(report.provenance, file="camera\udcff.npz")
    for form in FORMATS:
        write_report(tmp_path / "r", dataclasses.replace(report, provenance=provenance), form)
        assert "udcff" in (tmp_path / "r").read_text(encoding="utf-8")


def test_an_unknown_format_is_refused(report):
    with pytest.raises(InputError, match="html, md, json"):
        render(report, "pdf")


def test_a_place_that_cannot_be_written_is_refused(report, tmp_path):
    with pytest.raises(OutputError, match="folder does not exist"):
        write_report(tmp_path / "nowhere" / "r.html", report)


def test_something_else_is_no_report(tmp_path):
    (tmp_path / "page.html").write_text("<!doctype html><title>pinholify</title>")
    assert not is_report(tmp_path / "page.html")


def test_elements_escape_text_and_attributes_but_not_markup():
    inner = element("b", "<i>")
    assert element("p", "a & b", inner, title='"x"') == '<p title="&quot;x&quot;">a &amp; b<b>&lt;i&gt;</b></p>'
    assert isinstance(inner, Markup)
    assert element("img", alt="", hidden=True, class_=None) == '<img alt="" hidden>'


def test_numbers_are_written_to_the_digits_that_are_known():
    assert with_std(2.7303128, 0.0016789) == "2.7303 ± 0.0017"
    assert with_std(123.456, 12.3) == "123 ± 12"
    assert with_std(1.5, float("nan")) == "1.5000 ± unknown"
    assert (px(0.04567), px(1.234), px(12.34), px(1e9)) == ("0.046 px", "1.2 px", "12 px", "over 1000 px")
    assert (percent(0.00061), percent(0.77), percent(None)) == ("0.061 %", "77 %", "–")
    assert (number(-0.5, 2), number(None, 2), angle(12.6)) == ("−0.50", "–", "13°")
