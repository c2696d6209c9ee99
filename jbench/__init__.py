"""jbench: the Jitterbug problem as a benchmark with a results database."""

__version__ = "0.1.0"
