"""The command ``truemean``: its help, what it prints and writes, and that no error is a traceback."""

import json
import re
from pathlib import Path

import pytest
from tests.command_line import call, directory

import truemean
from truemean.adapters import available
from truemean.conformance.pixels import SETS
from truemean.errors import MissingExtra
from truemean.oracle.plans import catalogue
from truemean.reporting import RENDERERS

PIXEL = ("--pixel", "0:7/8,1:1/8")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The current directory, with subjects and plans."""
    yield from directory(tmp_path, monkeypatch)


# -- help -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["derive", "prove", "worst-case", "judge", "report", "figure", "list", "repl"])
def test_every_command_explains_each_option_and_gives_an_example(name):
    code, out, _ = call(name, "--help")
    assert code == 0
    assert re.search(rf"Examples:\n +truemean {name}\b", out)
    options = re.split(r"\n  (?=-)", out.partition("Options:")[2].partition("Examples:")[0])[1:]
    for option in options:
        assert len(re.sub(r"^\S+( [^ ]+)?  +", "", option).split()) >= 4, option
    assert name in call("--help")[1]


def test_the_help_of_judge_says_what_ci_needs_to_know():
    out = " ".join(call("judge", "--help")[1].split())
    for words in ("Exit codes: 0 CONFORMS", "1 BIASED", "3 INCONCLUSIVE", "python:FILE.py:NAME", "alpha", "100000"):
        assert words in out


def test_the_examples_of_the_help_can_be_typed(folder):
    examples = [
        line.strip()
        for name in ("derive", "prove", "worst-case", "list")
        for line in call(name, "--help")[1].splitlines()
    ]
    own = [line.removeprefix("truemean ") for line in examples if line.startswith("truemean ") and "my_" not in line]
    assert len(own) == 8
    for example in own:
        assert call(*(word.strip('"') for word in example.split()))[0] == 0


@pytest.mark.slow
def test_json_of_a_derivation_loads_no_charts(run, tmp_path):
    code = (
        "import sys; from typer.testing import CliRunner; import truemean.cli;"
        f"done = CliRunner().invoke(truemean.cli.app, ['derive', 'fixed', *{PIXEL}, '--json', '-']);"
        "print(done.exit_code, [name for name in ('matplotlib', 'jinja2', 'scipy', 'sympy') if name in sys.modules])"
    )
    assert run("-c", code, cwd=tmp_path).stdout == "0 []\n"


@pytest.mark.slow
def test_help_loads_nothing_heavy(run):
    heavy = ("numpy", "scipy", "sympy", "matplotlib", "flint", "mpmath", "rich.table", "jinja2")
    code = (
        "import sys; from typer.testing import CliRunner; import truemean.cli; before = set(sys.modules);"
        "done = CliRunner().invoke(truemean.cli.app, ['--help']);"
        f"print(done.exit_code, [name for name in {heavy} if name in sys.modules])"
    )
    assert run("-c", code).stdout == "0 []\n"


def test_the_version():
    assert call("--version")[:2] == (0, f"truemean {truemean.__version__}\n")


# -- derive ---------------------------------------------------------------------------------------


def test_derive_shows_the_papers_pixel():
    code, out, err = call("derive", "kirk-arvo", *PIXEL, "--set", "n=4")
    assert (code, err) == (0, "")
    for words in (
        "851/16384",
        "-1197/16384",
        "-0.5844726562",
        "range(S1) <= 0",
        "1201/2048",
        "S1 flat; rows: 3",
        "Fig. 1",
    ):
        assert words in out


def test_derive_writes_json_on_standard_output_and_into_a_file(folder):
    code, out, err = call("derive", "kirk-arvo", *PIXEL, "--json", "-")
    data = json.loads(out)
    assert (code, err, data["schema"]) == (0, "", "truemean-derive/1")
    assert data["bias"] == {"exact": "-1197/16384", "value": -1197 / 16384}
    assert [path["probability"]["exact"] for path in data["paths"]] == ["1201/2048", "847/2048"]
    assert data["plan"]["params"] == {"n": 4, "eps": 0}
    assert {"command", "commit", "versions", "level", "rows"} <= set(data)
    code, out, _ = call("derive", "kirk-arvo", *PIXEL, "--json", folder / "new.json")
    assert (code, "851/16384" in out) == (0, True)
    assert json.loads((folder / "new.json").read_text(encoding="utf-8"))["expectation"]["exact"] == "851/16384"


def test_derive_takes_colours_by_channel():
    code, out, _ = call("derive", "kirk-arvo", "--pixel", "(1,0):1/2,(0,0):1/2", "--set", "n=2")
    assert code == 0
    assert "bias[1]" in out
    assert "undefined where the true mean is 0" in out
    assert len(json.loads(call("derive", "fixed", "--pixel", "(1,0):1", "--json", "-")[1])["bias"]) == 2


def test_derive_writes_numbers_longer_than_python_does(folder):
    code, out, _ = call("derive", "kirk-arvo", *PIXEL, "--set", "n=6000", "--json", "long.json")
    assert (code, "digits...}" in out) == (0, True)
    exact = json.loads((folder / "long.json").read_text(encoding="utf-8"))["bias"]["exact"]
    assert re.fullmatch(r"-\d{4301,}/\d{4301,}", exact)


def test_derive_takes_values_beyond_the_floats():
    given = ("derive", "kirk-arvo", "--pixel", "0:1/2,1e400:1/2", "--set", "n=2")
    data = json.loads(call(*given, "--json", "-")[1])
    assert data["mse"] == {"exact": str(10**800 // 8), "value": None}
    assert data["std"] is None
    assert "1.250000000e+799" in call(*given)[1]


def test_derive_in_floats_gives_a_bound():
    data = json.loads(call("derive", "kirk-arvo", *PIXEL, "--arithmetic", "float64", "--json", "-")[1])
    assert abs(data["bias"]["value"] + 1197 / 16384) <= data["bias"]["error"] < 1e-12
    assert "error at most" in call("derive", "kirk-arvo", *PIXEL, "--arithmetic", "float64")[1]


def test_derive_shows_the_paths_that_matter_most(folder):
    code, out, _ = call("derive", "plans_of_cli.py:walk", *PIXEL)
    assert (code, "and 9 more paths" in out) == (0, True)
    assert len(json.loads(call("derive", "plans_of_cli.py:walk", *PIXEL, "--json", "-")[1])["paths"]) == 29


# -- report, figure and list ----------------------------------------------------------------------


@pytest.fixture
def built(monkeypatch):
    """What the report is asked to build, in place of building it."""
    asked = {}

    def build(out, subjects, *, command, seed, skipped, progress, pages, about):
        progress("half way", 0.5)
        asked.update(subjects={name: text for name, (text, _) in subjects.items()}, seed=seed, skipped=dict(skipped))
        asked.update(pages=pages)
        (out / "report.json").write_text("{}")
        return {"headline": "one sentence"}

    def judged(entries, seed, jobs, tell):
        tell("nothing is judged here")
        return {entry.page: {} for entry in entries}, {"a renderer that crashed": "and why"}

    monkeypatch.setattr("truemean.conformance.report.build", build)
    monkeypatch.setattr("truemean.reporting.judged", judged)
    return asked


def test_report_hands_in_plans_as_code_and_replaces_its_directory(folder, built):
    for _ in range(2):
        code, out, _ = call("report", "--renderers", "none", "--out", "new", "--seed", "3")
    assert (code, out.splitlines()[0]) == (0, "one sentence")
    assert [file.name for file in (folder / "new").iterdir()] == ["report.json"]
    assert built["seed"] == 3
    assert built["subjects"] == {
        "Fig. 1 in NumPy": "python:truemean.adapters.reference:KirkArvo",
        "Fig. 2 in NumPy": "python:truemean.adapters.reference:KirkArvoUnbiased",
    }


def test_report_says_how_to_get_a_missing_renderer(folder, built, monkeypatch):
    def load(subject, **_):
        if subject.startswith("raysect"):
            raise MissingExtra("pip install 'truemean[raysect]'")
        return subject

    monkeypatch.setattr("truemean.adapters.load", load)
    code, out, _ = call("report")
    assert (code, "raysect skipped: pip install 'truemean[raysect]'" in out) == (0, True)
    assert list(built["skipped"]) == ["raysect", "a renderer that crashed"]
    assert list(built["pages"]) == [name for name in RENDERERS if name != "raysect"]
    code, _, err = call("report", "--renderers", "raysect")
    assert (code, err) == (2, "truemean: pip install 'truemean[raysect]'\n")


def test_report_leaves_another_directory_alone(folder, built):
    (folder / "photos").mkdir()
    (folder / "photos" / "one.png").touch()
    code, _, err = call("report", "--out", "photos")
    assert (code, "without report.json" in err) == (2, True)
    assert (folder / "photos" / "one.png").exists()


def test_figure_draws_into_a_file(folder):
    assert call("figure", "3", "--out", "three.svg")[0] == 0
    assert "<svg" in (folder / "three.svg").read_text(encoding="utf-8")


def test_figure_takes_the_options_of_each_figure(folder):
    assert call("figure", "3", "--most", "8", "--out", "three.svg")[0] == 0
    assert ">12<" not in re.sub(r"\s", "", (folder / "three.svg").read_text(encoding="utf-8"))
    assert call("figure", "5", "--scene", "tile", "--n", "2", "--out", "five.svg")[0] == 0
    assert "n = 2" in (folder / "five.svg").read_text(encoding="utf-8")


def test_list_tells_all_there_is():
    plans, pixels, adapters = (call("list", what) for what in ("plans", "pixels", "adapters"))
    assert (plans[0], pixels[0], adapters[0]) == (0, 0, 0)
    for plan in catalogue.values():
        assert f"{plan.name}({next(iter(plan.signature.parameters))}=" in plans[1]
        assert f"{'unbiased' if plan.unbiased else 'biased'}: {plan.why}" in plans[1]
    for name, standard in ((f"{s}:{n}", pixel) for s, pixels_of in SETS.items() for n, pixel in pixels_of.items()):
        assert name in pixels[1]
        assert standard.stresses.split(":")[0] in " ".join(pixels[1].split())
    for adapter in available():
        assert adapter.how in adapters[1]


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["derive", "kirk-avro", *PIXEL], 2, "did you mean kirk-arvo"),
        (["derive", "plans_of_cli.py:reaches", *PIXEL], 2, "plan 'reaches' raised IndexError"),
        (["derive", "hierarchical", *PIXEL], 2, "needs a scene"),
        (["derive", "fixed", *PIXEL, "--arithmetic", "flaot64"], 2, "did you mean float64"),
        (["derive", "sequential", *PIXEL, "--rows", "3"], 2, "more than rows=3"),
        (["derive", "fixed", *PIXEL, "--json", "no/where.json"], 2, "--json 'no/where.json'"),
        (
            ["derive", "fixed", "--pixel", "0:1/2"],
            2,
            "pixel '0:1/2': weights 1/2 sum to 1/2, not to 1: add the missing 1/2",
        ),
        (["judge", "pyton:a:b", "--tolerance", "1%"], 2, "did you mean python"),
        (["judge", "python:subjects_of_cli.py:noise", "--tolerance", "1%"], 2, "did you mean noisy"),
        (
            ["judge", "python:subjects_of_cli.py:Broken", "--tolerance", "1%"],
            4,
            "can't be loaded: RuntimeError: no device (",
        ),
        (["judge", "plan:fixed", "--tolerance", "one"], 2, "tolerance='one'"),
        (["judge", "plan:fixed", "--tolerance", "1%", "--declares", "fixd"], 2, "did you mean fixed"),
        (["judge", "plan:fixed", "--tolerance", "1%", "--range", "1"], 2, "--range '1'"),
        (["judge", "plan:fixed", "--tolerance", "1%", "--alpha", "2"], 2, "alpha=2.0"),
        (["report", "--renderers", "raysekt"], 2, "did you mean raysect"),
        (["figure", "6", "--out", "x.svg"], 2, "no figure is called '6'"),
        (["figure", "3", "--out", "x.txt"], 2, "x.txt"),
        (["figure", "3", "--scene", "tile", "--out", "x.svg"], 2, "no option of figure 3 is called 'scene'"),
        (["figure", "5", "--scene", "tilo", "--out", "x.svg"], 2, "did you mean tile"),
        (["list", "plan"], 2, "did you mean plans"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_an_error_is_one_line_and_a_code(arguments, code, words, folder):
    found, out, err = call(*arguments)
    assert (found, out) == (code, "")
    *noise, line = err.splitlines()
    assert set(noise) <= {"noise of the plan", "noise of the subject"}
    assert line.startswith("truemean: ")
    assert words in line


@pytest.mark.parametrize("arguments", [[], ["derive"], ["judge", "plan:fixed"], ["figure", "3"], ["nothing"]])
def test_a_command_half_typed_is_wrong_use(arguments):
    assert call(*arguments)[0] == 2


def test_a_fault_of_ours_is_a_line_and_a_file(folder, monkeypatch):
    def fault(*arguments, **options):
        raise RuntimeError("a fault")

    monkeypatch.setattr("truemean.oracle.derive", fault)
    code, out, err = call("derive", "fixed", *PIXEL)
    (line,) = err.splitlines()
    assert (code, out) == (70, "")
    assert "RuntimeError: a fault" in line
    saved = re.search(r"\S+truemean-error-\S+\.txt", line)
    assert "in fault" in Path(saved[0]).read_text(encoding="utf-8")
    monkeypatch.setattr("tempfile.tempdir", str(folder / "gone"))
    assert call("derive", "fixed", *PIXEL)[2].endswith("could not be saved\n")


def test_an_interrupt_anywhere_is_130(monkeypatch):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("truemean.oracle.derive", interrupt)
    assert call("derive", "fixed", *PIXEL)[::2] == (130, "truemean: interrupted\n")


@pytest.mark.slow
@pytest.mark.parametrize("form", [("-m", "truemean"), ("-c", "from truemean.cli import main; main()")])
def test_the_program_runs_in_a_process_of_its_own(form, run, tmp_path):
    done = run("-P", *form, "derive", "kirk-arvo", *PIXEL, cwd=tmp_path)
    assert "851/16384" in done.stdout
    wrong = run("-P", *form, "derive", "kirk-avro", *PIXEL, cwd=tmp_path, check=False)
    assert (wrong.returncode, wrong.stdout) == (2, "")
    assert len(wrong.stderr.splitlines()) == 1
