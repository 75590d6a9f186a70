"""Conformance: whether an estimator has the true mean of a pixel, judged from its replicates."""

from truemean.conformance.judge import judge
from truemean.conformance.pixels import pixel_by_name, standard_pixels
from truemean.conformance.verdict import Case, PlanCheck, Report, Verdict

__all__ = ["Case", "PlanCheck", "Report", "Verdict", "judge", "pixel_by_name", "standard_pixels"]
