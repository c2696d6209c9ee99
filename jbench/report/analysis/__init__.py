"""Statistics, comparisons and claims."""
