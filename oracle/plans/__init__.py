"""The catalogue of sampling plans by name; one family a file, each plan reading like its listing."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType

from truemean.errors import InputError, PlanError, UnknownName, raised
from truemean.oracle.plan import Plan, as_plan

__all__ = ["catalogue", "find_plan"]

_PLANS = {
    "kirk-arvo": "truemean.oracle.plans.kirk_arvo:kirk_arvo",
    "kirk-arvo-unbiased": "truemean.oracle.plans.kirk_arvo:kirk_arvo_unbiased",
    "discard-pilot": "truemean.oracle.plans.two_stage:discard_pilot",
    "two-stage-pooled": "truemean.oracle.plans.two_stage:two_stage_pooled",
    "fixed": "truemean.oracle.plans.fixed:fixed",
    "sequential": "truemean.oracle.plans.sequential:sequential",
    "hierarchical": "truemean.oracle.plans.hierarchical:hierarchical",
    "centre-first": "truemean.oracle.plans.centre:centre_first",
    "centre-and-grid": "truemean.oracle.plans.centre:centre_and_grid",
}


class Catalogue(Mapping[str, Plan]):
    """Name -> plan, loaded when asked for; an unknown name lists the nearest ones."""

    def __getitem__(self, name: str) -> Plan:
        if name not in _PLANS:
            raise UnknownName("plan", name, _PLANS)
        module, _, function = _PLANS[name].partition(":")
        found: Plan = getattr(import_module(module), function)
        return found

    def __contains__(self, name: object) -> bool:
        return name in _PLANS

    def __iter__(self) -> Iterator[str]:
        return iter(_PLANS)

    def __len__(self) -> int:
        return len(_PLANS)


catalogue = Catalogue()


def find_plan(name: str) -> Plan:
    """A plan by catalogue name, ``file.py:function`` or ``module:function``.

    The current directory and the file's own are importable. UnknownName, InputError for what is not there,
    PlanError with the line for a file or module whose own code fails.

    >>> find_plan("fixed").doc
    'The mean of n samples.'
    """
    place, colon, function = name.rpartition(":")
    if name.endswith(".py"):
        raise InputError(f"plan={name!r} names a file but no function in it: write {name}:my_plan")
    if not colon:
        return catalogue[name]
    try:
        module = _import(place)
    except (Exception, SystemExit) as error:
        if isinstance(error, ModuleNotFoundError) and f"{place}.".startswith(f"{error.name}."):
            raise InputError(f"plan={name!r}: {error}; write file.py:function or module:function") from None
        raise PlanError(f"plan={name!r} can't be imported: {raised(error)}") from error
    if not hasattr(module, function):
        raise UnknownName(f"plan in {place}", function, [n for n, v in vars(module).items() if callable(v)])
    return as_plan(getattr(module, function))


def _import(place: str) -> ModuleType:
    """The module at a dotted name or a path, with the current directory and the file's own importable."""
    path = Path(place).resolve()
    is_file = path.suffix == ".py"
    for folder in [str(Path.cwd()), *([str(path.parent)] if is_file else [])]:
        if folder not in sys.path:
            sys.path.insert(0, folder)
    if not is_file:
        return import_module(place)
    if not path.is_file():
        raise ModuleNotFoundError(f"there is no file {place!r} in {Path.cwd()}", name=place)
    module = ModuleType(f"truemean_plan_{path.stem}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module
    SourceFileLoader(module.__name__, module.__file__).exec_module(module)
    return module
