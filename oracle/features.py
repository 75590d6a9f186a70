"""Levels: how finely a sample has to be observed for what a path asks of it.

A level is a set of *features*. Idempotent ones (flat, extremes, support) form a chain of
semilattices; additive ones (sum, squares) are sums over draws by column; counts and sequence
determine everything symmetric, and everything.
"""

from __future__ import annotations

from collections.abc import Iterable

__all__ = ["IDEMPOTENT", "Level", "gives", "level", "squares", "total"]

IDEMPOTENT = ("flat", "extremes", "support")


class Level(frozenset[str]):
    """A set of features; prints as its name in the table of levels."""

    def __str__(self) -> str:
        if not self:
            return "unseen"
        parts = [name for name in ("sequence", "counts", "support", "extremes", "flat") if name in self]
        sums = [f for f in self if f.startswith("sum")]
        if sums:
            parts.append("moments" if any(f.startswith("squares") for f in self) else "sum")
        return " x ".join(parts)

    def __repr__(self) -> str:
        return f"<{self}>"


def total(column: int) -> str:
    """The feature: sum of a column."""
    return f"sum:{column}"


def squares(column: int) -> str:
    """The feature: sum of squares of a column."""
    return f"squares:{column}"


def level(features: Iterable[str], channels: int) -> Level:
    """The coarsest level that determines all features asked for.

    >>> str(level(["flat", "extremes"], 1)), str(level(["extremes", "sum:0", "squares:0"], 1))
    ('extremes', 'extremes x moments')
    """
    asked = set(features)
    for everything in ("sequence", "counts"):
        if everything in asked:
            return Level({everything})
    asked |= {total(int(f.split(":")[1])) for f in asked if f.startswith("squares")}
    idempotent = [f for f in IDEMPOTENT if f in asked]
    kept = {f for f in asked if f.startswith(("sum", "squares"))} | set(idempotent[-1:])
    if "flat" in kept and all(squares(c) in kept for c in range(channels)):
        kept.discard("flat")
    return Level(kept)


def gives(found: frozenset[str], feature: str, channels: int) -> bool:
    """Whether a level determines a feature."""
    if feature in found or "sequence" in found:
        return True
    if "counts" in found:
        return feature != "sequence"
    if feature == "extremes":
        return "support" in found
    if feature == "flat":
        return bool({"support", "extremes"} & found) or all({total(c), squares(c)} <= found for c in range(channels))
    return False
