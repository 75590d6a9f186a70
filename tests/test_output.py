"""What the command line writes: numbers of any length for people, files, and directories that are replaced as a whole."""

import json
from fractions import Fraction

import pytest

from truemean.errors import InputError
from truemean.oracle import Approx
from truemean.oracle.exact import exact_text
from truemean.output import decimal, replaced, shortened, write_json, write_text

LONG = Fraction(-(7**6000), 8**6000)


def test_a_long_number_is_shortened_for_people_and_a_short_one_is_not():
    assert len(shortened(LONG)) < 80
    assert shortened(LONG).startswith(exact_text(LONG)[:7])
    assert shortened(LONG).endswith(exact_text(LONG)[-7:])
    for value in (Fraction(0), Fraction(-3), Fraction(-1197, 16384), Fraction(10**23, 7)):
        assert shortened(value) == str(value) == exact_text(value)


def test_a_decimal_is_right_below_and_beyond_the_floats():
    assert decimal(Fraction(-1, 3)) == "-0.3333333333"
    assert decimal(Fraction(0)) == "0"
    assert decimal(Fraction(2, 3 * 10**500), 4) == "6.667e-501"
    assert decimal(Fraction(2 * 10**500, 3), 4) == "6.667e+499"
    assert decimal(Approx(0.25, 1e-17)) == "0.25"


def test_json_carries_command_commit_and_versions(tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["anything", "derive", "a b"])
    write_json(str(tmp_path / "x.json"), {"schema": "s", "versions": {"subject": "7"}})
    data = json.loads((tmp_path / "x.json").read_text(encoding="utf-8"))
    assert data["command"] == "truemean derive 'a b'"
    assert data["versions"]["subject"] == "7"
    assert {"truemean", "python", "numpy"} <= set(data["versions"])
    assert data["commit"] is None or len(data["commit"].removesuffix("-dirty")) == 40


def test_a_file_that_cannot_be_written_is_wrong_use(tmp_path):
    with pytest.raises(InputError, match="can't be written"):
        write_text(str(tmp_path), "text")


def break_off(directory, error):
    with replaced(directory, "report.json") as new:
        (new / "report.json").write_text("half")
        raise error


def finish(directory, text="new"):
    with replaced(directory, "report.json") as new:
        assert new != directory
        (new / "report.json").write_text(text)


@pytest.mark.parametrize("before", ["nothing", "empty", "former"])
def test_a_directory_appears_or_is_replaced_as_a_whole(before, tmp_path):
    directory = tmp_path / "deep" / "out"
    if before != "nothing":
        directory.mkdir(parents=True)
    if before == "former":
        (directory / "report.json").write_text("old")
        (directory / "stale.html").write_text("old")
    finish(directory)
    assert [file.name for file in directory.iterdir()] == ["report.json"]
    assert (directory / "report.json").read_text() == "new"
    assert [path.name for path in directory.parent.iterdir()] == ["out"]


def test_the_old_directory_stays_until_the_new_one_is_complete(tmp_path):
    directory = tmp_path / "out"
    finish(directory, "old")
    for error in (RuntimeError, KeyboardInterrupt):
        with pytest.raises(error):
            break_off(directory, error)
        assert (directory / "report.json").read_text() == "old"
        assert list(tmp_path.iterdir()) == [directory]


def test_a_directory_that_is_no_former_report_is_refused(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "one.png").write_text("precious")
    (tmp_path / "file").write_text("precious")
    for name, why in (("photos", "without report.json"), ("file", "is a file")):
        with pytest.raises(InputError, match=why), replaced(tmp_path / name, "report.json"):
            pytest.fail("it began to write")
    assert (tmp_path / "photos" / "one.png").read_text() == (tmp_path / "file").read_text() == "precious"


def test_a_link_to_a_report_stays_a_link(tmp_path):
    finish(tmp_path / "real", "old")
    (tmp_path / "link").symlink_to("real", target_is_directory=True)
    finish(tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "report.json").read_text() == "new"
