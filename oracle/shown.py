"""What a derivation does with its symbols: show itself, become a function, tell how it falls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

from numpy.typing import NDArray

from truemean.errors import InputError
from truemean.oracle.exact import is_symbolic
from truemean.oracle.formulas import formula

if TYPE_CHECKING:
    import numpy as np

    from truemean.oracle.derivation import Derivation
    from truemean.oracle.rates import Rates

__all__ = ["Shown"]


class Shown:
    """A derivation in a notebook, a terminal, a plot or as a NumPy function."""

    # -- its symbols -------------------------------------------------------------------------

    @cached_property
    def all_symbols(self) -> tuple[Any, ...]:
        """The symbols of the pixel and the parameters: weights first, then values, then parameters."""
        X, params = self._self.pixel, self._self.params.values()
        numbers = [x for x in (*X.weights, *X.values, *params) if is_symbolic(x)]
        return tuple(dict.fromkeys(s for x in numbers for s in sorted(x.free_symbols, key=str)))

    @property
    def symbols(self) -> tuple[Any, ...]:
        """`all_symbols` without the weight that follows from the others."""
        return tuple(s for s in self.all_symbols if s not in self._self.pixel.simplex)

    def lambdify(self, *symbols: Any, result: str = "bias") -> Callable[..., NDArray[np.float64]]:
        """A result as a vectorised NumPy function of its symbols (`symbols`, unless others are listed).

        Numerically stable: rows are evaluated, not the formula. Where all weights are open the last one
        follows from the others. Raises InputError for symbols that are not the result's.

        >>> from sympy import Symbol
        >>> from truemean.oracle import Pixel, derive
        >>> from truemean.oracle.plans import catalogue
        >>> f = derive(catalogue["kirk-arvo"], Pixel.symbolic(2, values=(0, 1)), n=Symbol("n")).lambdify()
        >>> f([0.875, 0.25], 4).round(6)
        array([-0.073059,  0.076172])
        """
        from truemean.oracle.lambdified import lambdified

        return lambdified(self._self, symbols, result)

    def rates(self, n: Any = "n") -> Rates:
        """Limit and leading term of the bias in a sample size that is a symbol, and whether the plan is consistent.

        >>> from sympy import Symbol
        >>> from truemean.oracle import Pixel, derive
        >>> from truemean.oracle.plans import catalogue
        >>> d = derive(catalogue["kirk-arvo"], Pixel.two("1/4"), n=Symbol("n"))
        >>> d.rates().leading, d.rates().consistent
        (-(3/4)**n/4, True)
        """
        from truemean.oracle.rates import rates

        if self._self.colour:
            raise InputError("rates() is for scalar pixels: derive each channel")
        return rates(self._self.biases[0], self._self.field, n)

    # -- showing itself ----------------------------------------------------------------------

    def latex(self, result: str = "bias") -> str:
        """A result as a LaTeX equation."""
        from truemean.oracle.display import as_latex

        return as_latex(self._self, result)

    def plot(self, over: Any = None, **settings: Any) -> Any:
        """The bias over a symbol, drawn by Matplotlib; see `truemean.oracle.plotting.plot`."""
        from truemean.oracle.plotting import plot

        return plot(self._self, over, **settings)

    def __str__(self) -> str:
        from truemean.oracle.display import as_text

        return as_text(self._self)

    def _repr_html_(self) -> str:
        from truemean.oracle.display import as_html

        return as_html(self._self)

    def short(self, name: str) -> Any:
        """A result by name, as displays show it: formulas in terms of I where that is shorter."""
        d = self._self
        numbers: dict[str, Callable[[], list[Any]]] = {
            "bias": lambda: d.biases,
            "mse": lambda: d.mean_squared_errors,
            "variance": lambda: d.variances,
            "expectation": lambda: [b + t for b, t in zip(d.biases, d.truths, strict=True)],
        }
        if name == "relative_bias" and d.symbolic and not d.colour and len(d.field.number(d.truths[0]).num) > 1:
            return self.short("bias") / formula(d.truths[0], d.truths[0])
        if not d.symbolic or name not in numbers:
            return getattr(d, name)
        found = [formula(x, d.truths[c]) for c, x in enumerate(numbers[name]())]
        return tuple(found) if d.colour else found[0]

    def short_paths(self) -> Iterator[tuple[tuple[str, ...], Any, Any]]:
        """Decisions, probability and bias of each path, as displays show them."""
        d = self._self
        for number, path in enumerate(d.paths):
            bias = path.bias
            if d.symbolic and not d.colour:
                bias = formula(d.path_biases[0][number], d.truths[0])
            yield path.decisions, path.probability, bias

    @property
    def _self(self) -> Derivation:
        return cast("Derivation", self)
