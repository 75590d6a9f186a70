"""The catalogue of sampling plans by name; one family a file, each plan reading like its listing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from truemean.errors import UnknownName
from truemean.oracle.plan import Plan

__all__ = ["catalogue"]

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
