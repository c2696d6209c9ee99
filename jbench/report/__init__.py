"""Reports: learning curves over seeds, tables, figures and a page. See `write_report`."""

from jbench.report.report import Report, write_report

__all__ = ["Report", "write_report"]
