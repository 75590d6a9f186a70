"""The application ``truemean``, and how a command is registered with it."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Annotated, Any

import typer

from truemean import __version__
from truemean.exits import CODES, exit_code

__all__ = ["app", "command"]

app = typer.Typer(
    name="truemean",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["--help", "-h"]},
    epilog=CODES,
)


def command(name: str, *examples: str) -> Callable[[Callable[..., int]], Callable[..., None]]:
    """Register a command that returns its exit code; whatever it raises becomes one line and a code."""

    def register(function: Callable[..., int]) -> Callable[..., None]:
        @functools.wraps(function)
        def run(**arguments: Any) -> None:
            raise typer.Exit(exit_code(functools.partial(function, **arguments)))

        app.command(name, epilog="\b\n" + "\n".join(["Examples:", *(f"  {example}" for example in examples)]))(run)
        return run

    return register


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"truemean {__version__}")
        raise typer.Exit


@app.callback()
def root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """What an adaptive sampling plan is worth exactly, and whether an implementation has the true mean.

    derive computes bias, variance and cost of a PLAN on a pixel, without running it. judge runs a
    SUBJECT (your code, a renderer) and says, with evidence, whether its mean is the pixel's. report
    writes both for everything that is installed. Every command has its own --help with examples.
    """
