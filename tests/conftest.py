"""What every test may use: the repository, its own files, and other programs."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import hypothesis
import pytest

import truemean
from truemean.adapters import available

ROOT = Path(__file__).parents[1]
FOLDERS = ("oracle", "conformance", "adapters")
LINKS = tuple(f"src/truemean/{folder}" for folder in FOLDERS)
BUILD_INPUTS = ("pyproject.toml", "MANIFEST.in", "README.md", "LICENSE")

os.environ.setdefault("MPLBACKEND", "agg")
# Every run sees the same examples; `--hypothesis-profile=explore` looks for new ones.
hypothesis.settings.register_profile("same", derandomize=True, deadline=None)
hypothesis.settings.register_profile("explore", deadline=None, max_examples=1000, print_blob=True)
hypothesis.settings.load_profile("same")

Run = Callable[..., subprocess.CompletedProcess[str]]


def pytest_report_header() -> str:
    """Which optional subjects this run can test, and how to get the others."""
    optional = [adapter for adapter in available() if adapter.how != "built in"]
    there = [f"{adapter.name} {adapter.version}" for adapter in optional if adapter.version]
    missing = [f"{adapter.name} ({adapter.how})" for adapter in optional if not adapter.version]
    return f"truemean {truemean.__version__}, with {', '.join(there) or 'no renderer'}; missing: {', '.join(missing) or 'none'}"


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository."""
    return ROOT


@pytest.fixture(scope="session")
def package_files() -> dict[str, Path]:
    """Every tracked file of the package: its name once installed -> where it is."""
    names = {f"src/truemean/{name}": f"truemean/{name}" for name in _files("src/truemean")}
    names |= {f"{folder}/{name}": f"truemean/{folder}/{name}" for folder in FOLDERS for name in _files(folder)}
    return {installed: ROOT / name for name, installed in names.items() if name not in LINKS}


@pytest.fixture
def checkout(tmp_path: Path, package_files: dict[str, Path]) -> Path:
    """A clean copy of what a build sees, with links: building leaves its traces there, not here."""
    target = tmp_path / "checkout"
    for source in [*package_files.values(), *(ROOT / name for name in BUILD_INPUTS)]:
        copy = target / source.relative_to(ROOT)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, copy)
    for link in LINKS:
        (target / link).symlink_to(Path("../..", Path(link).name), target_is_directory=True)
    return target


@pytest.fixture(scope="session")
def run() -> Run:
    """``run(*arguments, cwd=...)`` starts Python on this process's truemean, wherever the cwd."""

    def python(
        *arguments: str | Path, cwd: Path = ROOT, path: Path | None = None, check: bool = True
    ) -> subprocess.CompletedProcess[str]:
        library = path or Path(truemean.__file__).parents[1]
        done = subprocess.run(
            [sys.executable, *map(str, arguments)],
            cwd=cwd,
            env={**os.environ, "PYTHONPATH": str(library), "COLUMNS": "120"},
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
        )
        if check and done.returncode:
            pytest.fail(f"{' '.join(map(str, arguments))} ended with {done.returncode}\n{done.stdout}{done.stderr}")
        return done

    return python


def _files(folder: str) -> list[str]:
    """Names relative to ``folder`` of the files in it that git knows or would take; without git, of all."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listed = subprocess.run(command, cwd=ROOT / folder, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError):
        found = [path for path in (ROOT / folder).rglob("*") if path.is_file() and path.suffix != ".pyc"]
        return sorted(path.relative_to(ROOT / folder).as_posix() for path in found)
    return [name for name in listed.split("\0") if name and (ROOT / folder / name).exists()]
