"""The reference report: the paper's figures recomputed, the plans compared, implementations judged."""

from truemean.conformance.report.assemble import TOLERANCE, build, figure, judged_html, judged_markdown
from truemean.conformance.report.verdicts import judge_one

__all__ = ["TOLERANCE", "build", "figure", "judge_one", "judged_html", "judged_markdown"]
