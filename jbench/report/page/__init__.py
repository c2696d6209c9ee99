"""The report's page: one HTML file with everything in it. See `render_document`."""

from jbench.report.page.whole import render_document, still

__all__ = ["render_document", "still"]
