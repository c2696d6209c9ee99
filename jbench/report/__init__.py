"""Reports: learning curves over seeds, tables, figures and a page."""
