"""`python -m wrenchflow`."""

import sys

from wrenchflow.cli import main

if __name__ == "__main__":  # Spawned workers import this module again, and must not run it.
    sys.exit(main())
