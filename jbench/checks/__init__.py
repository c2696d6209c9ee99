"""What jbench checks on demand: this machine, and code of others."""
