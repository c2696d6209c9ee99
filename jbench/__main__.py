"""The command line as `python -m jbench`."""

import sys

from jbench.cli import main

if __name__ == "__main__":
    sys.argv[0] = "jbench"  # as records name the command
    sys.exit(main())
