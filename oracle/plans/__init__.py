"""The catalogue of sampling plans by name; one family a file, each plan reading like its listing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from truemean.errors import InputError, UnknownName
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

    >>> find_plan("fixed").doc
    'The mean of n samples.'
    """
    place, colon, function = name.rpartition(":")
    if not colon:
        return catalogue[name]
    try:
        if place.endswith(".py"):
            spec = spec_from_file_location(Path(place).stem, place)
            assert spec is not None and spec.loader is not None
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
        else:
            module = import_module(place)
    except (FileNotFoundError, ModuleNotFoundError) as error:
        raise InputError(f"plan={name!r}: {error}; write file.py:function or module:function") from None
    if not hasattr(module, function):
        raise UnknownName(f"plan in {place}", function, [n for n, v in vars(module).items() if callable(v)])
    return as_plan(getattr(module, function))
