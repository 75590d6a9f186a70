"""A page for each renderer, beside the report that leads to it."""

from __future__ import annotations

import json

from tests.conformance.report.conftest import HOSTILE


def test_each_renderer_has_a_page_that_the_report_leads_to(built):
    page, text = ((built.folder / f"engine.{suffix}").read_text("utf-8") for suffix in ("html", "md"))
    assert '<a href="engine.html">' in built.html
    assert "](engine.md)" in built.markdown
    assert "of 1 configuration of engine, 1 " in built.returned["headline"]
    assert "<p>How it decides.</p>" in page
    assert "<b>was</b>" not in page
    assert "What \\<b\\>was\\</b\\> found." in text
    assert "<script>alert" not in page
    assert "truemean judge own:engine --tolerance 5% --budget 2000 --seed 3" in page


def test_the_data_of_all_pages_are_in_one_file(built):
    data = json.loads((built.folder / "report.json").read_text("utf-8"))
    (report,) = data["pages"]["engine"].values()
    assert report["runs"] > 0
    assert report["seconds"] > 0
    assert data["verdicts"][HOSTILE + "2"] == report["verdict"]
