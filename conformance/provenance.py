"""What a report was made with: versions of everything, and the commit."""

from __future__ import annotations

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import truemean

__all__ = ["commit", "versions"]

PACKAGES = ("numpy", "scipy", "sympy", "mpmath", "python-flint", "matplotlib", "jinja2")


def versions() -> dict[str, str]:
    """The versions of truemean, Python, the machine's system and every base package."""
    found = {"truemean": truemean.__version__, "python": platform.python_version(), "system": platform.platform()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not found"
    return found


def commit() -> str | None:
    """The commit of the checkout that truemean runs from, ``-dirty`` when files differ; None outside of one."""
    folder = Path(truemean.__file__).resolve().parent
    try:
        top = _git(folder, "rev-parse", "--show-toplevel")
        if Path(top, "src", "truemean").resolve() != folder:  # installed somewhere inside another project
            return None
        found = _git(folder, "rev-parse", "HEAD")
        return found + ("-dirty" if _git(folder, "status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603 - git, with words of ours
    return done.stdout.strip()
