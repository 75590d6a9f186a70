"""Conformance: whether an estimator has the true mean of a pixel, judged from its replicates."""

from truemean.conformance.checking import Check, check_subject
from truemean.conformance.judge import judge
from truemean.conformance.pixels import load_pixels, pixel_by_name, standard_pixels
from truemean.conformance.planning import plan_run
from truemean.conformance.verdict import Case, PlanCheck, Region, Report, Verdict

__all__ = [
    "Case",
    "Check",
    "PlanCheck",
    "Region",
    "Report",
    "Verdict",
    "check_subject",
    "judge",
    "load_pixels",
    "pixel_by_name",
    "plan_run",
    "standard_pixels",
]
