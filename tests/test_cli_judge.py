"""``truemean judge``: its exit codes, its files, and what an interrupt or a closed pipe leaves of a verdict."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.command_line import call, directory

import truemean
from truemean.conformance.pixels import SETS
from truemean.exits import judged_code

LIBRARY = str(Path(truemean.__file__).parents[1])
# A process started in the background may ignore interrupts.
INTERRUPTIBLE = (
    "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); from truemean.cli import main; main()"
)
posix = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals and a POSIX shell")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, with subjects and plans."""
    yield from directory(tmp_path, monkeypatch)


def judge(name, *arguments):
    pixels = () if "--pixels" in arguments else ("--pixels", "0:1/2,1:1/2")
    return call("judge", f"python:subjects_of_cli.py:{name}", "--tolerance", "10%", *pixels, *arguments)


@pytest.mark.parametrize(
    ("name", "code", "verdict"),
    [("exact", 0, "CONFORMS"), ("shifted", 1, "BIASED"), ("nan", 4, "BROKEN"), ("noisy", 3, "INCONCLUSIVE")],
)
def test_the_exit_code_is_the_verdict(name, code, verdict, folder):
    found, out, _ = judge(name, "--range", "0,1", "--budget", "20" if name == "noisy" else "10000")
    assert (found, out.splitlines()[-1].startswith(f"{verdict} at a tolerance of 10%: python:")) == (code, True)


@pytest.mark.parametrize(
    ("verdict", "deviates", "interrupted", "code"),
    [
        ("CONFORMS", False, False, 0),
        ("CONFORMS", True, False, 1),
        ("INCONCLUSIVE", True, False, 1),
        ("INCONCLUSIVE", False, False, 3),
        ("BROKEN", True, False, 4),
        ("CONFORMS", False, True, 130),
        ("BROKEN", False, True, 130),
    ],
)
def test_the_exit_code_weighs_verdict_plan_and_interrupt(verdict, deviates, interrupted, code):
    assert judged_code(verdict, deviates=deviates, interrupted=interrupted) == code


def test_a_subject_that_does_not_follow_its_plan_deviates(folder):
    code, out, _ = judge("noisy", "--declares", "fixed?n=4", "--seed", "7")
    assert (code, "DEVIATES: it does not follow" in out) == (1, True)


def test_judge_writes_every_format_and_repeats_with_its_seed(folder):
    files = [f for kind in ("json", "html", "markdown") for f in (f"--{kind}", f"verdict.{kind}")]
    assert judge("noisy", "--seed", "5", *files)[0] == 0
    data = json.loads((folder / "verdict.json").read_text(encoding="utf-8"))
    assert (data["schema"], data["seed"]) == ("truemean-judge/1", 5)
    assert data["subject"] == "python:subjects_of_cli.py:noisy"
    assert {"command", "commit", "versions", "cases"} <= set(data)
    assert "CONFORMS" in (folder / "verdict.html").read_text(encoding="utf-8")
    assert "CONFORMS" in (folder / "verdict.markdown").read_text(encoding="utf-8")
    out = judge("noisy", "--seed", "5", "--json", "-")[1]
    assert json.loads(out)["cases"] == data["cases"]


def test_judge_takes_the_pixels_asked_for(folder):
    code, out, _ = judge("exact", "--pixels", "hard", "--pixels", "standard:thin", "--json", "-")
    assert list(dict.fromkeys(case["pixel"] for case in json.loads(out)["cases"])) == [*SETS["hard"], "standard:thin"]
    assert code == 0


def test_judge_runs_a_plan_of_the_catalogue():
    code, out, _ = call("judge", "plan:kirk-arvo?n=4", "--tolerance", "1%", "--pixels", "0:7/8,1:1/8", "--json", "-")
    (case,) = json.loads(out)["cases"]
    assert (code, case["verdict"], case["declared_bias"]["exact"]) == (1, "BIASED", "-1197/16384")


@pytest.mark.slow
@posix
def test_an_interrupted_run_shows_and_writes_its_evidence(folder):
    judged = ["judge", "python:subjects_of_cli.py:patient", "--tolerance", "0", "--pixels", "0:1/2,1:1/2"]
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTIBLE, *judged, "--json", "evidence.json"],
        env={"PYTHONPATH": LIBRARY},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not (folder / "started").exists() and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, "Traceback" in err) == (130, False)
    assert "interrupted; this is the evidence so far" in err
    assert "INCONCLUSIVE at a tolerance of 0" in out
    assert json.loads((folder / "evidence.json").read_text(encoding="utf-8"))["interrupted"] is True


@pytest.mark.slow
@posix
@pytest.mark.parametrize("more", ["", "--json -"])
def test_a_reader_that_stops_reading_changes_no_verdict(more, folder):
    judged = f"judge python:subjects_of_cli.py:shifted --range 0,2 --tolerance 10% --pixels standard:eighth {more}"
    done = subprocess.run(
        ["bash", "-c", f"{sys.executable} -m truemean {judged} 2>err | true; echo ${{PIPESTATUS[0]}}"],
        env={"PYTHONPATH": LIBRARY, "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "1\n"
    assert "Traceback" not in (folder / "err").read_text()
