"""Tests of jbench, by room: tests/<room>/test_<module>.py."""
