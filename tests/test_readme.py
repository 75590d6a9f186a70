"""README.md and pages of docs are run from top to bottom: their files, their Python, their commands and their output.

A block whose first line is a comment with a file name is that file. A python block is executed (with ``>>>`` as a
doctest), all in one namespace. A block of commands starts with ``truemean ``; a command ends with 0, or as its
comment ``# exit code 1`` says. A text block is the output of the commands before it, ``...`` for what is left
out. Any other block has on the line before it ``<!-- not run: reason -->``, or ``<!-- ci: tests -->`` if .ci/run runs it.
"""

from __future__ import annotations

import doctest
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

import truemean

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
MARK = re.compile(r"<!-- (?:not run: \S.*|ci: tests) -->\s*$")
FILE_NAME = re.compile(r"# ([\w./-]+\.\w+)\n")


class Block(NamedTuple):
    """A fenced block: its language, text, first line number, and what is to be done with it."""

    language: str
    text: str
    line: int
    kind: str


def blocks(markdown):
    """The fenced blocks in order; ValueError for one that is neither run nor marked."""
    found = []
    for match in FENCE.finditer(markdown):
        language, text = match.groups()
        before = markdown[: match.start()]
        line = before.count("\n") + 2
        shown = next((block.kind for block in reversed(found) if block.kind != "marked"), None)
        found.append(Block(language, text, line, kind_of(language, text, before, shown)))
        if found[-1].kind == "unknown":
            raise ValueError(f"README.md:{line}: a {language or 'bare'} block that nothing runs: mark it with a reason")
    return found


def kind_of(language, text, before, shown):
    if MARK.search(before):
        return "marked"
    if FILE_NAME.match(text):
        return "file"
    if language == "python":
        return "python"
    if language in {"bash", "sh"} and text.startswith("truemean "):
        return "commands"
    return "output" if language == "text" and shown == "commands" else "unknown"


def run_readme(markdown, directory):
    """Run all blocks in ``directory``; AssertionError with the README's line where one does not do as shown."""
    found = blocks(markdown)
    for block in found:
        if block.kind == "file":
            file = directory / FILE_NAME.match(block.text)[1]
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(block.text)
    namespace = {"__name__": "__main__"}
    output = ""
    for block in found:
        if block.kind == "python":
            run_python(block, namespace)
        elif block.kind == "commands":
            output = "".join(run_command(command, directory, block.line) for command in commands(block.text))
        elif block.kind == "output":
            shown_as = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
            same = doctest.OutputChecker().check_output(block.text, output, shown_as)
            assert same, f"README.md:{block.line}: the commands before print\n{output}"


def run_python(block, namespace):
    if ">>>" not in block.text:
        exec(compile("\n" * (block.line - 1) + block.text, "README.md", "exec"), namespace)
        return
    example = doctest.DocTestParser().get_doctest(block.text, {}, "README.md", "README.md", block.line - 1)
    example.globs = namespace
    report = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    failed = runner.run(example, out=report.append, clear_globs=False).failed
    assert not failed, "".join(report)


def commands(text):
    """The commands of a block, each on one line."""
    return [line for line in text.replace("\\\n", " ").splitlines() if line.strip()]


def run_command(command, directory, line):
    """Standard output of ``command``; like the installed program it does not find modules of the cwd by itself."""
    program = f'truemean() {{ {shlex.quote(sys.executable)} -P -m truemean "$@"; }}\n'
    expected = int(found[1]) if (found := re.search(r"# exit code (\d+)$", command)) else 0
    library = str(Path(truemean.__file__).parents[1])
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", program + command],
        cwd=directory,
        env={**os.environ, "PYTHONPATH": library, "COLUMNS": "120"},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )
    ended = f"README.md:{line}: {command!r} ended with {done.returncode}\n{done.stdout}{done.stderr}"
    assert done.returncode == expected, ended
    return done.stdout


@pytest.fixture
def directory(tmp_path, monkeypatch):
    """An empty cwd whose modules can be imported, and are forgotten afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or ROOT).is_relative_to(tmp_path):
            del sys.modules[name]


@pytest.mark.slow
@pytest.mark.parametrize("page", ["README.md", "docs/verdicts.md", "docs/protocol.md"])
def test_the_page_does_as_it_shows(page, directory):
    run_readme((ROOT / page).read_text(encoding="utf-8"), directory)


SOUND = """
<!-- not run: it fetches the repository -->
```bash
git clone somewhere
```
```python
# half.py
value = 1 / 2
```
```python
from half import value
twice = 2 * value
```
```python
>>> twice
1.0
```
"""


def test_a_sound_readme_passes(directory):
    run_readme(SOUND, directory)
    assert [block.kind for block in blocks(SOUND)] == ["marked", "file", "python", "python"]


@pytest.mark.parametrize("block", ["```bash\nls\n```", "```\nplain\n```", "```text\nno commands before\n```"])
@pytest.mark.parametrize("mark", ["", "<!-- not run: -->\n", "<!-- not run: reason -->\n\ntext between\n"])
def test_a_block_that_nothing_runs_is_refused(mark, block):
    with pytest.raises(ValueError, match="mark it with a reason"):
        blocks(f"{mark}{block}\n")


@pytest.mark.parametrize("wrong", ["```python\nassert twice == 2\n```\n", "```python\n>>> twice\n2.0\n\n```\n"])
def test_a_wrong_python_block_fails(wrong, directory):
    with pytest.raises(AssertionError):
        run_readme(SOUND + wrong, directory)


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        "```bash\ntruemean no-such-command\n```\n",
        "```bash\ntruemean --help # exit code 1\n```\n",
        "```bash\ntruemean --help\n```\n```text\nsomething else\n```\n",
    ],
)
def test_a_wrong_command_fails(wrong, directory):
    with pytest.raises(AssertionError, match=r"README.md:\d"):
        run_readme(wrong, directory)


@pytest.mark.slow
def test_a_sound_command_passes(directory):
    lines = "```bash\ntruemean --help | tr a-z A-Z\ntruemean no-such-command \\\n  2> oops # exit code 2\n```\n"
    run_readme(lines + "```text\n...USAGE:...DERIVE...\n```\n", directory)
    assert "no-such-command" in (directory / "oops").read_text()
