"""The recorder for training loops outside jbench, and results as data frames."""
