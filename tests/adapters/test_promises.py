"""Every configuration that the report judges keeps the promises of an estimator, and says so from where it is run."""

from __future__ import annotations

import pytest

from truemean.adapters import available, load
from truemean.adapters.registry import ADAPTERS
from truemean.conformance import check_subject
from truemean.reporting import CODE, RENDERERS, about

VERSIONS = {adapter.name: (adapter.version, adapter.how) for adapter in available()}
CONFIGURATIONS = [
    pytest.param(
        subject,
        id=subject,
        marks=pytest.mark.skipif(VERSIONS[page][0] is None, reason=f"needs {page}: {VERSIONS[page][1]}"),
    )
    for page, (_, subjects) in RENDERERS.items()
    for subject in subjects.values()
]


@pytest.mark.parametrize("subject", [*CODE.values(), *CONFIGURATIONS])
def test_it_keeps_the_promises_of_an_estimator(subject):
    checks = check_subject(load(subject), replicates=16)
    assert len(checks) >= 7


def test_every_renderer_of_the_registry_is_in_the_report():
    renderers = {name for name, adapter in ADAPTERS.items() if adapter.package or adapter.probe}
    assert set(RENDERERS) == renderers


@pytest.mark.parametrize("page", RENDERERS)
def test_a_page_can_say_how_its_renderer_decides(page):
    assert len(about(page)) > 300
