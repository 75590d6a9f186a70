"""A Python prompt with the oracle's names imported: IPython's if it is installed, else Python's own."""

from __future__ import annotations

import sys
from typing import Any

__all__ = ["interact", "names"]

BANNER = """truemean: the exact worth of a sampling plan.
  d = derive(catalogue["kirk-arvo"], Pixel.symbolic(2), n=n)   its bias as a formula: d.bias, d.latex(), d.plot()
  prove(catalogue["kirk-arvo-unbiased"])                       is it unbiased, and why?
  worst_case(catalogue["kirk-arvo"], n=4)                      the pixel on which it is worst
Imported: {names}"""


def names() -> dict[str, Any]:
    """What the prompt knows."""
    from fractions import Fraction

    import numpy as np
    import sympy

    from truemean import oracle
    from truemean.oracle.plans import catalogue

    own = {name: getattr(oracle, name) for name in oracle.__all__}
    symbols = {name: sympy.Symbol(name) for name in ("n", "m", "eps", "k", "w")}
    return {**own, **symbols, "catalogue": catalogue, "Fraction": Fraction, "Symbol": sympy.Symbol, "np": np}


def interact() -> None:
    """Run the prompt until its input ends."""
    known = names()
    banner = BANNER.format(names=", ".join(sorted(known)))
    try:
        from IPython import start_ipython
        from traitlets.config import Config
    except ImportError:
        import code

        code.interact(banner, local=known, exitmsg="")
        return
    config = Config()
    config.TerminalInteractiveShell.banner1 = f"{banner}\n"
    config.TerminalInteractiveShell.confirm_exit = False
    config.TerminalInteractiveShell.simple_prompt = not sys.stdin.isatty()
    config.HistoryManager.enabled = sys.stdin.isatty()
    start_ipython(argv=[], user_ns=known, config=config)
