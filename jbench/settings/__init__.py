"""Settings of runs, datasets and evaluations; ids contain a hash of them.

Those of encoders are in `encoders/registry.py`, since the kinds of encoders are plug-ins.
"""
