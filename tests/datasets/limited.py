"""Runs commands with a limit on the size of files, which imitates a full disk."""

import importlib
import resource

from jbench import cli

# Imported by name, since the package has a function of the same name.
collecting = importlib.import_module("jbench.datasets.collect")


def main(size, *arguments):
    """Runs a command; returns its exit code.

    Args:
        size: of the largest file that can be written, in bytes; -1 for any.
        arguments: of the command.
    """
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))
    return cli.main(list(arguments))


def collect(size, results):
    """Collects 20 episodes of 100 control steps, one to a file; returns the exit code."""
    collecting._PART_EPISODES, collecting.EPISODE_STEPS = 1, 100
    return main(size, "collect", "--steps", "2000", "--seed", "3", "--results", results)
