"""report.json holds exact numbers, report.md the tables, and the figures become files."""

from __future__ import annotations

import re
from fractions import Fraction

import pytest

from truemean.conformance.report import figure
from truemean.errors import InputError, UnknownName

BEGINNINGS = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}


def numbers(data):
    """Every exact number in ``data`` with the float beside it."""
    if isinstance(data, dict):
        if set(data) == {"exact", "value"}:
            yield Fraction(data["exact"]), data["value"]
        else:
            for part in data.values():
                yield from numbers(part)
    elif isinstance(data, list):
        for part in data:
            yield from numbers(part)


def test_json_has_its_schema_and_says_how_to_replay(built):
    data = built.data
    assert data == built.returned
    assert data["schema"] == "truemean-report/1"
    assert (data["command"], data["seed"]) == ("truemean report --out <here>", 3)
    assert {"truemean", "python", "numpy", "matplotlib", "python-flint"} <= set(data["versions"])
    assert data["commit"] is None or re.fullmatch("[0-9a-f]{40}(-dirty)?", data["commit"])
    assert list(data["verdicts"].values()) == ["CONFORMS", "BIASED", "BROKEN", "CONFORMS"]
    assert list(data["skipped"]) == ["a renderer"]
    assert set(data["sections"]) == {"verdicts", "bias", "images", "plans", "speed"}


def test_each_subject_is_named_and_can_be_judged_alone(built):
    assert built.data["headline"].startswith("At a tolerance of 1 % of a pixel’s range, honest CONFORMS in")
    assert built.data["sections"]["verdicts"]["honest"]["subject"] == "own:honest?n=4"
    line = "truemean judge 'own:honest?n=4' --tolerance 1% --budget 100000 --seed 3"
    assert built.data["alone"]["honest"] == line
    assert f"    {line}\n" in built.markdown
    assert "| honest, own:honest?n=4 |" in built.markdown


def test_every_float_in_json_is_its_exact_number_rounded(built):
    pairs = list(numbers(built.data))
    assert len(pairs) > 7 * 32 * 2
    assert all(float(exact) == value for exact, value in pairs)


def test_verdicts_in_json_are_the_judges(built):
    reports = built.data["sections"]["verdicts"]
    assert {report["schema"] for report in reports.values()} == {"truemean-judge/1"}
    honest, _, broken = reports.values()
    assert honest["skipped"] == {"equal-luminance": "no <b>colours</b> here"}
    assert {case["verdict"] for case in broken["cases"]} == {"BROKEN"}


def test_markdown_tables_are_whole(built):
    blocks = re.findall(r"(?:^\|.*\|\n)+", built.markdown, re.MULTILINE)
    assert len(blocks) > 8
    for block in blocks:
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in block.splitlines()}) == 1


def test_markdown_trusts_no_name(built):
    assert re.search(r"(?<!\\)<", re.sub(r"^    .*$", "", built.markdown, flags=re.MULTILINE)) is None
    assert r"\<script\>alert('1\|2')\</script\> \& \*stars\*" in built.markdown


def test_progress_goes_from_nothing_to_all(built):
    fractions = [fraction for _, fraction in built.told]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0, 1)
    assert len(fractions) > 20


@pytest.mark.parametrize("suffix", BEGINNINGS)
@pytest.mark.parametrize(
    ("name", "options"), [("3", {"most": 4}), ("4", {"most": 4}), ("5", {"scene": "tile"}), ("speed-accuracy", {})]
)
def test_a_figure_is_a_file_of_the_kind_asked_for(name, options, suffix, tmp_path):
    out = tmp_path / f"figure.{suffix}"
    figure(name, out, **options)
    assert out.read_bytes().startswith(BEGINNINGS[suffix])


@pytest.mark.parametrize(
    ("name", "out", "options", "said"),
    [
        ("6", "f.svg", {}, "figure is called '6'"),
        ("3", "f.svg", {"many": 4}, "option of figure 3 is called 'many'"),
        ("3", "f.gif", {"most": 2}, "f.gif"),
        ("3", "no such folder/f.svg", {"most": 2}, "no such folder"),
    ],
)
def test_a_figure_that_can_not_be_is_refused(name, out, options, said, tmp_path):
    with pytest.raises(InputError, match=re.escape(said)) as refused:
        figure(name, tmp_path / out, **options)
    assert isinstance(refused.value, UnknownName) == ("called" in said)
