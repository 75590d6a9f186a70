"""How long a process takes to start: ``pytest tests/benchmarks``; the ratio is to bare Python.

Whole processes are timed, on the truemean that this one imported. No test asserts a time.
"""

from __future__ import annotations

import pytest

COMMANDS = {
    "bare Python": ["-c", "pass"],
    "import truemean": ["-c", "import truemean"],
    "import truemean.oracle": ["-c", "import truemean.oracle"],
    "truemean --help": ["-m", "truemean", "--help"],
    "truemean list plans": ["-m", "truemean", "list", "plans"],
}


@pytest.mark.parametrize("command", COMMANDS)
def test_start(benchmark, run, command):
    benchmark.group = "start of a process"
    done = benchmark(run, *COMMANDS[command])
    assert done.stderr == ""
