"""Expressions in words: the formula of a quantity, a decision or its negation."""

from __future__ import annotations

from typing import Any

from truemean.oracle.exact import short_text

__all__ = ["text"]

_NEGATED = {"<": ">=", "<=": ">", ">": "<=", ">=": "<", "==": "!=", "!=": "=="}
_INFIX = {"+": 1, "-": 1, "*": 2, "/": 2, "**": 3}


def text(node: Any, side: bool = True, tight: int = 0) -> str:
    """The formula of a node in the words of the plan; ``side=False`` writes a decision's negation."""
    if not hasattr(node, "op"):
        return str(node)
    if not side:
        return _negated(node)
    op, args = node.op, node.args
    if op == "const":
        return short_text(args[0])
    if op == "truth":
        return str(args[0])
    if op in _INFIX:
        level = _INFIX[op]
        if op == "*" and args[0].op == "const" and args[0].args[0] == -1:
            return f"-{text(args[1], tight=3)}"
        inner = f"{text(args[0], tight=level)} {op} {text(args[1], tight=level + 1)}"
        return f"({inner})" if level < tight else inner
    if op in _NEGATED:
        return f"{text(args[0])} {op} {text(args[1])}"
    if op in ("and", "or"):
        return f"({text(args[0])} {op} {text(args[1])})"
    if op == "not":
        return text(args[0], side=False)
    if op in ("stat", "flat", "mean", "sum"):
        return str(args[0].describe(node))
    if op == "true mean":
        return "true mean" if args[0].name == "X" else f"true mean of {args[0].name}"
    return f"{op}({', '.join(map(text, args))})"


def _negated(node: Any) -> str:
    if node.op in _NEGATED:
        return f"{text(node.args[0])} {_NEGATED[node.op]} {text(node.args[1])}"
    if node.op == "not":
        return text(node.args[0])
    if node.op == "flat" and node.args[5]:
        return text(node).replace(f" {node.args[5]} ", f" {_NEGATED[node.args[5]]} ")
    return f"not {text(node)}"
