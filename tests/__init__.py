"""Tests of jbench; those of a module are in tests/<package>/test_<module>.py."""
