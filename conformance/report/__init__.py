"""The reference report: the paper's figures recomputed, the plans compared, implementations judged."""

from truemean.conformance.report.assemble import build, figure, judged_html, judged_markdown

__all__ = ["build", "figure", "judged_html", "judged_markdown"]
