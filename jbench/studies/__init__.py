"""Studies: which runs are made, which are compared, and how a comparison is decided.

Sweeps and reports read the same plan here, and decide it by the same function.
"""
