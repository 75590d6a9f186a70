"""Programs and shared libraries, compiled where there is a compiler."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from truemean.adapters.libraries import HEADER

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples"
COMPILERS = {
    ".c": ("gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-O2", "-I", str(HEADER.parent)),
    ".cpp": ("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "-O2", "-I", str(HEADER.parent)),
    ".rs": ("rustc", "-O", "-D", "warnings"),
}
SHARED = {".c": ("-shared", "-fPIC"), ".cpp": ("-shared", "-fPIC"), ".rs": ("--crate-type", "cdylib")}
MISSING = {
    ".c": "needs a C compiler: apt-get install gcc",
    ".cpp": "needs a C++ compiler: apt-get install g++",
    ".rs": "needs a Rust compiler: apt-get install rustc",
}


class Compiled:
    """What has been compiled into a folder; each source once, when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def program(self, name: str) -> Path:
        """``docs/examples/protocol/NAME`` as a program."""
        return self._make(EXAMPLES / "protocol" / name, ())

    def library(self, name: str) -> Path:
        """``docs/examples/library/NAME`` as a library."""
        source = EXAMPLES / "library" / name
        return self._make(source, SHARED[source.suffix])

    def functions(self, text: str, name: str) -> Path:
        """A library made of C code that includes truemean.h."""
        source = self.folder / f"{name}.c"
        source.write_text(f'#include "truemean.h"\n{text}')
        return self._make(source, SHARED[".c"])

    def code(self, text: str, name: str) -> Path:
        """A program made of C code."""
        source = self.folder / f"{name}.c"
        source.write_text(text)
        return self._make(source, ())

    def _make(self, source: Path, flags: tuple[str, ...]) -> Path:
        compiler, *options = COMPILERS[source.suffix]
        if shutil.which(compiler) is None:
            pytest.skip(MISSING[source.suffix])
        made = self.folder / f"{source.name}.{'so' if flags else 'run'}"
        if not made.exists():
            subprocess.run([compiler, *options, *flags, "-o", made, source], check=True, cwd=self.folder)
        return made
