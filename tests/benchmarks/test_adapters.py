"""What it costs to reach code in other languages: ``pytest tests/benchmarks/test_adapters.py``.

A replicate of ``exec:`` is timed in batches of 100, 1,000 and 100,000, of a program in C that does next to nothing: what is left is
the way there and back. A path of ``lib:`` is one run of code that asks for its samples, EstimateMean of Kirk & Arvo's
Fig. 1 in docs/examples/library/fig1.c, through the loop over all answers in Python and through the compiled one. Each
prints its rate; no test asserts a time.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.adapters.compiled import Compiled
from tests.adapters.programs import program

from truemean.adapters import asking, load
from truemean.adapters.libraries import AskingFunction, open_function
from truemean.oracle import Pixel
from truemean.subject import PlainPixel

IDLE = r"""
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

static double values[1 << 20];
static uint64_t seeds[1 << 20];

int main(void) {
    char line[256], word[16];
    long n = 0;
    while (fgets(line, sizeof line, stdin) && sscanf(line, "%15s %ld", word, &n) >= 1) {
        if (!strcmp(word, "truemean")) printf("truemean 1 binary\n");
        if (!strcmp(word, "pixel")) {
            for (long i = 0; i < n; i++) if (!fgets(line, sizeof line, stdin)) return 1;
            printf("ok\n");
        }
        if (!strcmp(word, "batch")) {
            if (fread(seeds, 8, (size_t)n, stdin) != (size_t)n) return 1;
            for (long i = 0; i < n; i++) values[i] = (double)(seeds[i] & 1);
            fwrite(values, 8, (size_t)n, stdout);
        }
        fflush(stdout);
    }
    return 0;
}
"""
EIGHTH, TONES = Pixel.two("1/8"), Pixel(dict.fromkeys(range(16), "1/16"))


@pytest.fixture(scope="session")
def compiled(tmp_path_factory):
    return Compiled(tmp_path_factory.mktemp("adapters"))


def tell(benchmark, number, unit, *, rate):
    """Print how long each of ``number`` took, or how many a second."""
    seconds = benchmark.stats.stats.median
    shown = f"{number / seconds:,.0f} {unit}s a second" if rate else f"{seconds / number * 1e6:.2f} us a {unit}"
    print(f"\n{benchmark.name}: {shown}")  # noqa: T201 - what this is run for


@pytest.mark.parametrize("size", [100, 1000, 100_000])
@pytest.mark.parametrize("form", ["binary, C", "text, Python"])
def test_replicates_of_a_program(benchmark, compiled, tmp_path, form, size):
    benchmark.group = "a batch of exec:"
    if form == "binary, C":
        subject = load(f"exec:{compiled.code(IDLE, 'idle')}")
    else:
        subject = load(program(tmp_path, "estimate = lambda seed: 0.25"))
    seeds = iter(range(10**9))
    benchmark(lambda: subject.run(EIGHTH, np.arange(size) + next(seeds)))
    tell(benchmark, size, "replicate", rate=False)


@pytest.mark.parametrize("loop", ["compiled", "in Python"])
def test_paths_of_a_function_that_asks(benchmark, compiled, loop):
    benchmark.group = "all paths of code that asks, 65,536"
    made = open_function(str(compiled.library("fig1.c")), "fig1", True, 300_000, "sequence")
    function = AskingFunction(made.function, made.loop if loop == "compiled" else None, "fig1", 300_000, "sequence")
    found = benchmark(lambda: function.exact(PlainPixel.of(TONES)))
    assert (found.paths, function.loop is None) == (16**4, loop == "in Python")
    tell(benchmark, found.paths, "path", rate=True)


def test_paths_of_a_python_function(benchmark):
    def fig1(draw):
        samples = [draw(), draw(), draw(), draw()]
        return samples[0] if len({*samples}) == 1 else 7.5

    benchmark.group = "all paths of code that asks, 65,536"
    subject = asking(fig1)
    found = benchmark(lambda: subject.enumerate(TONES))
    tell(benchmark, found.paths, "path", rate=True)


@pytest.mark.parametrize("order", ["sequence", "all"])
def test_paths_of_a_program_that_asks(benchmark, compiled, order):
    benchmark.group = "all paths of a program that asks"
    pixel = Pixel(dict.fromkeys(range(8), "1/8"))
    subject = load(f"exec:{compiled.program('estimator.rs')}?order={order}")
    found = benchmark.pedantic(lambda: subject.enumerate(pixel), rounds=3)
    tell(benchmark, found.paths, "path", rate=True)
