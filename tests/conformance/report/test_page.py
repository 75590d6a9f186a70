"""The page stands alone, is well formed, says in words what its charts show, and trusts no name."""

from __future__ import annotations

import re
from collections import Counter
from html.parser import HTMLParser

import pytest

from truemean.conformance import judge
from truemean.conformance.report import judged_html, judged_markdown
from truemean.oracle import Pixel

VOID = {"meta", "link", "br", "img", "hr"}


class Page(HTMLParser):
    """Elements with their attributes and texts, and what was left open or closed wrongly."""

    def __init__(self, html):
        super().__init__()
        self.elements, self.open, self.wrong = [], [], []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), []))
        if tag not in VOID:
            self.open.append(self.elements[-1])

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), []))

    def handle_endtag(self, tag):
        if not self.open or self.open[-1][0] != tag:
            self.wrong.append(tag)
        else:
            self.open.pop()

    def handle_data(self, data):
        for _, _, texts in self.open:
            texts.append(data)

    def all(self, tag):
        return [(attrs, " ".join("".join(texts).split())) for name, attrs, texts in self.elements if name == tag]

    @property
    def ids(self):
        return [attrs["id"] for _, attrs, _ in self.elements if "id" in attrs]


@pytest.fixture(scope="module")
def page(built):
    return Page(built.html)


def test_every_element_is_closed_where_it_should_be(page):
    assert (page.wrong, page.open) == ([], [])


def test_ids_are_unique_and_every_reference_meets_one(page, built):
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    named = {name for _, attrs, _ in page.elements for name in (attrs.get("aria-labelledby") or "").split()}
    linked = {attrs["href"][1:] for _, attrs, _ in page.elements if (attrs.get("href") or "").startswith("#")}
    drawn = set(re.findall(r"url\(#([^)]*)\)", built.html))
    assert len(drawn) > 10
    assert len(linked) > 10
    assert (named | linked | drawn) - set(page.ids) == set()


def test_nothing_points_outside(built):
    inside = re.sub(r"data:image/png;base64,[A-Za-z0-9+/=\s]*", "", built.html)
    assert "//" not in inside
    assert re.search(r"https?:|@import|xmlns|<metadata", inside) is None
    assert set(re.findall(r'(?:src|href)="([^#"][^"]*)"', inside)) <= {
        "data:,",
        "data:image/png;base64,",
        "engine.html",
        "",
    }


def test_it_is_smaller_than_two_megabytes(built):
    assert len(built.html.encode()) < 2_000_000


def test_it_has_the_bones_of_a_page(page, built):
    assert built.html.startswith("<!DOCTYPE html>")
    assert [attrs["lang"] for attrs, _ in page.all("html")] == ["en"]
    assert len(page.all("h1")) == len(page.all("main")) == len(page.all("title")) == 1
    assert page.all("h1")[0][1] == " ".join(built.data["headline"].split())
    assert "prefers-color-scheme: dark" in built.html
    assert "@media print" in built.html


def test_every_chart_and_table_has_a_caption(page):
    figures, captions = page.all("figure"), page.all("figcaption")
    assert len(figures) == len(captions) > 10
    assert all(len(text) > 20 for _, text in captions if not text.startswith("broken"))
    charts = page.all("svg")
    assert len(charts) == 5 + 3 + 1  # of the plans, of each subject, and the power of the one that declares a plan
    assert all(attrs["role"] == "img" and attrs["aria-labelledby"].endswith("-caption") for attrs, _ in charts)


def test_heads_of_tables_have_a_scope_and_rows_are_complete(page, built):
    assert all(attrs["scope"] in {"col", "row"} for attrs, _ in page.all("th"))
    for table in re.findall(r"<table.*?</table>", built.html, re.DOTALL):
        rows = [len(re.findall(r"<t[hd][ >]", row)) for row in re.findall(r"<tr>.*?</tr>", table, re.DOTALL)]
        assert len(set(rows)) == 1
        assert rows[0] > 1


def test_what_scrolls_can_be_reached_by_keyboard(page):
    scrolling = [attrs for attrs, _ in page.all("div") if attrs.get("class") == "scroll"]
    assert len(scrolling) == len(page.all("figure"))
    assert all(attrs["tabindex"] == "0" and attrs["role"] == "region" for attrs in scrolling)


def test_names_from_outside_are_only_text(page, built):
    assert page.all("script") == page.all("b") == []
    assert any("<script>alert('1|2')</script> & *stars*" in text for _, text in page.all("th"))
    assert "no <b>colours</b> here" in [text for _, text in page.all("td")]
    assert "truemean report --out <here>" in [text for _, text in page.all("code")]


def test_verdicts_are_words_and_colours(page):
    chips = {text for attrs, text in page.all("span") if attrs.get("class") == "chip"}
    assert {"BIASED", "BROKEN", "CONFORMS", "FOLLOWS"} <= chips
    assert {"biased", "broken", "conforms"} <= {attrs.get("class") for attrs, _ in page.all("td")}


def test_what_was_not_run_is_said_with_the_line_that_installs_it(page):
    assert "not installed: pip install 'truemean[renderer]'" in [text for _, text in page.all("td")]


def test_a_single_judgement_is_a_page_too():
    def half_dark(pixel, seeds):
        return 0.5 * seeds % 1

    report = judge(half_dark, pixels={"a|b": Pixel.two("1/2")}, tolerance="1%", budget=100)
    page = Page(judged_html(report))
    assert (page.wrong, page.open) == ([], [])
    assert len(page.all("svg")) == 1
    assert str(report.verdict) in page.all("h1")[0][1]
    assert r"a\|b" in judged_markdown(report)
