"""The house style, as far as a program can see it: linters, types, import contracts, and sizes."""

import ast
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("src/truemean", "oracle", "conformance", "adapters", "tests")
FILES = sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py"))
SOURCES = [file for file in FILES if not file.is_relative_to(ROOT / "tests")]
PAGE = 40  # lines of a function without its docstring
STEP = 20  # lines of a step of a longer one, each under its comment
LINT_IMPORTS = "import sys; from importlinter.cli import lint_imports_command; sys.exit(lint_imports_command())"


def name(file):
    return file.relative_to(ROOT).as_posix()


def code_and_comments(file):
    """The numbers of the lines that hold code (docstrings too), and of those that hold a comment alone."""
    with file.open("rb") as stream:
        tokens = [token for token in tokenize.tokenize(stream.readline) if token.type != tokenize.ENCODING]
    silent = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    code = {n for t in tokens if t.type not in silent for n in range(t.start[0], t.end[0] + 1)}
    return code, {t.start[0] for t in tokens if t.type == tokenize.COMMENT} - code


def docstring_lines(node):
    if ast.get_docstring(node) is None:
        return set()
    return set(range(node.body[0].lineno, node.body[0].end_lineno + 1))


def longest_step(lines, comments):
    """The largest number of ``lines`` between two comments."""
    steps = [0]
    for line in sorted(lines | comments):
        if line in comments:
            steps.append(0)
        else:
            steps[-1] += 1
    return max(steps)


def too_long(file):
    """The functions of ``file`` that are longer than a page and not told in steps."""
    code, comments = code_and_comments(file)
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            span = set(range(node.lineno, (node.end_lineno or 0) + 1)) - docstring_lines(node)
            if len(span & code) > PAGE and longest_step(span & code, span & comments) > STEP:
                yield f"{node.name} (line {node.lineno})"


def thawed_dataclasses(file):
    """The dataclasses of ``file`` that are not frozen."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else ():
            text = ast.unparse(decorator)
            if text.partition("(")[0].endswith("dataclass") and "frozen=True" not in text:
                yield node.name


@pytest.mark.slow
@pytest.mark.parametrize(
    "command",
    [
        ["-m", "ruff", "check"],
        ["-m", "ruff", "format", "--check"],
        ["-m", "mypy"],
        ["-c", LINT_IMPORTS],
    ],
    ids=["ruff", "format", "mypy", "imports"],
)
def test_the_checker_is_content(command, run):
    run(*command, cwd=ROOT)


@pytest.mark.parametrize("file", FILES, ids=name)
def test_a_function_is_a_page_or_told_in_steps(file):
    assert list(too_long(file)) == []


@pytest.mark.parametrize("file", FILES, ids=name)
def test_a_file_is_short(file):
    lines = file.read_text(encoding="utf-8").count("\n")
    assert lines < 400


@pytest.mark.parametrize("file", SOURCES, ids=name)
def test_a_dataclass_is_frozen(file):
    assert list(thawed_dataclasses(file)) == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_comments_are_few(folder):
    counts = [code_and_comments(file) for file in FILES if file.is_relative_to(ROOT / folder)]
    code, comments = (sum(map(len, lines)) for lines in zip(*counts, strict=True))
    assert comments <= code / 10


def test_the_measures_see_what_they_should(tmp_path):
    file = tmp_path / "sample.py"
    line = "    x = 1\n"
    file.write_text(f'def page():\n    """Doc."""\n{39 * line}\n\ndef long():\n{40 * line}')
    assert list(too_long(file)) == ["long (line 44)"]
    file.write_text(f"def steps():\n{19 * line}    # Go on\n{20 * line}    # And on\n{20 * line}")
    assert list(too_long(file)) == []
    file.write_text(
        "@dataclass\nclass A: ...\n@dataclass(frozen=True)\nclass B: ...\n@d.dataclass(slots=True)\nclass C: ...\n"
    )
    assert list(thawed_dataclasses(file)) == ["A", "C"]
    file.write_text("# one\nx = 1  # beside code\n\n'''# no comment\n# nor this'''\n")
    assert code_and_comments(file) == ({2, 4, 5}, {1})
