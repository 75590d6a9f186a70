"""The bias of Fig. 1 (eps = 0) with symbolic weights by other systems: Storm's parametric engine and lea.

Each gives an expression in w1..w(k-1), the last weight being what they leave of 1, as SymPy.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Bias = Callable[[], Any]


def weights(k: int) -> list[str]:
    """The names of the weights."""
    names = [f"w{i}" for i in range(1, k)]
    return [*names, "1-" + "-".join(names)]


def storm(k: int, n: int) -> Bias:
    """A Markov chain over counts, its reward at the end the bias of the outcome."""
    stormpy = pytest.importorskip("stormpy", reason="pip install 'truemean[peers]' for Storm and lea")
    counts, mean = [f"c{i}" for i in range(k)], " + ".join(f"({w})*{i * i}" for i, w in enumerate(weights(k)))
    lines = ["dtmc", *(f"const double {w};" for w in weights(k)[:-1]), "module pilot"]
    lines += [f"{c} : [0..{n}] init 0;" for c in counts] + ["done : bool init false;"]
    steps = " + ".join(f"{w} : ({c}'={c}+1)" for w, c in zip(weights(k), counts, strict=True))
    lines += [f"[] {'+'.join(counts)}<{n} -> {steps};", f"[] {'+'.join(counts)}={n} & !done -> 1 : (done'=true);"]
    lines += ["[] done -> 1 : true;", "endmodule", 'rewards "bias"']
    lines += [f"{c}={n} & !done : {i * i} - ({mean});" for i, c in enumerate(counts)] + ["endrewards"]

    def bias() -> Any:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "pilot.prism")
            file.write_text("\n".join(lines))
            program = stormpy.parse_prism_program(str(file))
        asked = stormpy.parse_properties('R{"bias"}=? [F done]', program)
        model = stormpy.build_model[stormpy.RationalFunction](program, asked)
        return str(stormpy.model_checking(model, asked[0]).get_value(0)).replace("^", "**")

    return bias


def lea(k: int, n: int) -> Bias:
    """The law of the counts, then a sum over it."""
    pmf = pytest.importorskip("lea", reason="pip install 'truemean[peers]' for Storm and lea").pmf

    def bias() -> Any:
        X = pmf({i * i: w for i, w in enumerate(weights(k))}, prob_type="s", normalization=False)
        counts = X.map(lambda value: tuple(int(value == i * i) for i in range(k)))
        law = counts.times(n, lambda a, b: tuple(x + y for x, y in zip(a, b, strict=True)))
        return sum(p * (c.index(n) ** 2 - X.mean()) for c, p in law.pmf_tuple() if n in c)

    return bias
