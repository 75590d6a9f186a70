"""The command ``truemean``: derive, prove, worst-case, judge, report, ...; ``--help`` says what each is for.

Nothing heavy is imported before a command runs, so that help costs nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from truemean import deriving, judging, options
from truemean.commands import app, command
from truemean.errors import UnknownName

__all__ = ["app", "deriving", "judging", "main"]


def main() -> None:
    """The program ``truemean``."""
    app(prog_name="truemean")


@command("figure", "truemean figure 3 --out fig3.svg", "truemean figure 5 --scene tile --n 2 --out fig5.png")
def figure(
    name: options.FigureName,
    out: options.Picture,
    most: options.Most = None,
    scene: options.SceneName = None,
    n: options.Pilot = None,
) -> int:
    """Draw one figure of the report into a file."""
    from truemean.arguments import check_destination
    from truemean.output import working

    check_destination("--out", out)
    given = {"most": most, "scene": scene, "n": n}
    with working(f"drawing figure {name}"):
        from truemean.conformance.report import figure as draw

        draw(name, out, **{option: value for option, value in given.items() if value is not None})
    return 0


@command("list", "truemean list plans", "truemean list methods")
def list_(
    what: options.ListName,
) -> int:
    """List the plans, the pixels, the adapters or the methods there are.

    Plans with their parameters and whether they are unbiased, pixels with what they stress, adapters
    (what runs a SUBJECT) with how to get those that are not installed, methods of evidence with what they
    guarantee.
    """
    from truemean import tables
    from truemean.adapters import available
    from truemean.oracle.plans import catalogue

    lists: dict[str, Callable[[], None]] = {
        "plans": lambda: tables.print_plans(catalogue.values()),
        "pixels": tables.print_pixels,
        "adapters": lambda: tables.print_adapters(available()),
        "methods": tables.print_methods,
    }
    if what not in lists:
        raise UnknownName("list", what, lists)
    lists[what]()
    return 0
