"""Reports: learning curves over seeds, tables, figures and a page. See `write_report`."""

from jbench.report.report import Report, write_report
from jbench.report.request import Request

__all__ = ["Report", "Request", "write_report"]
