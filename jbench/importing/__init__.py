"""Learning curves that were made outside jbench, most of them as records of the results."""
