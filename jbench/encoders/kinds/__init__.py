"""The kinds of encoders that ship with jbench."""
