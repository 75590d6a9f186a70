"""All paths of a plan: run, put off, replayed, until none is left."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from truemean.errors import NoClosedForm, RowBudgetExceeded
from truemean.oracle.features import Level
from truemean.oracle.law import Law
from truemean.oracle.observing import Observer, Replay
from truemean.oracle.paths import Path, Pending, Point
from truemean.oracle.pixel import Pixel
from truemean.oracle.rows import Rows
from truemean.oracle.symbols import Field
from truemean.oracle.tables import Table, power, rows_of

if TYPE_CHECKING:
    from truemean.oracle.sub_estimate import SubLaw

__all__ = ["Exploration"]

_VERIFIED_DECISIONS = 20_000


class Exploration:
    """All paths of a plan on a pixel, and the needs that they have noted."""

    def __init__(
        self,
        function: Callable[..., Any],
        pixel: Pixel,
        params: dict[str, Any],
        budget: int,
        lenient: bool,
        parent: Exploration | None = None,
        weightless: bool = False,
        field: Field | None = None,
    ) -> None:
        self.function, self.pixel, self.params = function, pixel, params
        self.budget, self.lenient, self.weightless = budget, lenient, weightless
        self.field: Field = field or (parent.field if parent else Field())
        self.laws: dict[Any, Law] = parent.laws if parent else {}
        self.pixels: dict[int, tuple[Pixel, Law]] = parent.pixels if parent else {}
        self.tables: dict[Any, Any] = parent.tables if parent else {}
        self.subplans: dict[Any, SubLaw] = parent.subplans if parent else {}
        self.observer = Observer(self.tables, self.check_budget, lenient)
        self.root = Point(())
        self.start = Rows()
        self._paths: list[Path] | None = None

    @property
    def paths(self) -> list[Path]:
        """Every path, depth first, the answer "yes" before "no"."""
        if self._paths is None:
            self._paths = self._explore()
        return self._paths

    def prepared(self, prepare: Callable[[Path], Any]) -> list[Any]:
        """What ``prepare`` makes of every path; a need that it notes sends all paths round again."""
        while True:
            try:
                return [prepare(path) for path in self.paths]
            except Replay:
                self._paths = None

    def _explore(self) -> list[Path]:
        pending = [Pending((), self.start)]
        finished: list[Path] = []
        replayed = 0
        while pending:
            task = pending.pop()
            path = Path(self, task)
            try:
                path.run()
            except Replay as need:
                below = need.label[0].prefix
                pending = [p if p.prefix[: len(below)] != below else Pending(p.prefix, None) for p in pending]
                pending.append(Pending(task.prefix, None))
                continue
            if replayed < _VERIFIED_DECISIONS:
                path.verify()
                replayed += len(path.taken)
            finished.append(path)
            pending += path.forks
        return finished

    # -- what paths share --------------------------------------------------------------------

    def table(self, law: Law, n: Any, wanted: Level, asked: str) -> Table:
        """A table, made once; RowBudgetExceeded if it would have too many rows."""
        key = (law, n, wanted)
        if key not in self.tables:
            try:
                rows = rows_of(law, n, wanted)
            except NoClosedForm as error:
                raise NoClosedForm(f"{asked}: {error}") from None
            self.check_budget(rows, f"{asked}: {n} draws of {law.k} values at level {wanted}")
            self.tables[key] = power(law, n, wanted)
        found: Table = self.tables[key]
        return found

    def check_budget(self, rows: int, asked: str) -> None:
        """Complain before memory runs out."""
        if rows > self.budget:
            raise RowBudgetExceeded(
                f"{asked} needs {rows:,} rows, more than rows={self.budget:,}: decide on a coarser statistic, draw less, "
                f"give a larger rows=, or use rows='sampled' for an interval"
            )

    def law_of(self, pixel: Pixel) -> Law:
        """The law of a pixel; equal pixels share it, and it is open while weights are."""
        known = self.pixels.get(id(pixel))
        if known is None:
            key = (pixel.values, pixel.weights)
            if pixel is self.pixel and not self.weightless:
                known = (pixel, self._one_draw(pixel))
            else:
                known = (pixel, self.laws.setdefault(key, self._equal_law(pixel)))
            self.pixels[id(pixel)] = known
        return known[1]

    def _equal_law(self, pixel: Pixel) -> Law:
        """The law of the plan's own pixel if it is the same; else a new one."""
        whole = self.pixel
        if pixel is not whole and (pixel.values, pixel.weights) == (whole.values, whole.weights):
            return self.law_of(whole)
        if not self.weightless:
            return self._one_draw(pixel)
        law = Law([v if isinstance(v, tuple) else (v,) for v in pixel.values], pixel.weights)
        law.open = True
        return law

    def _one_draw(self, pixel: Pixel) -> Law:
        if not pixel.symbols:
            return pixel.one_draw
        if pixel.count is not None:
            from truemean.oracle.indexed import IndexedLaw

            return IndexedLaw(self.field, pixel.values[0], pixel.weights[0], pixel.count)
        from truemean.oracle.symbolic import SymbolicLaw

        return SymbolicLaw(self.field, pixel.law, pixel.ordered)
