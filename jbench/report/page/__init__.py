"""The report's page, a self-contained HTML file. See `render_document`."""

from jbench.report.page.whole import render_document

__all__ = ["render_document"]
