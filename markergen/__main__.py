"""Lets ``python -m markergen`` do what ``markergen`` does."""

import sys

from markergen.cli import main

if __name__ == "__main__":
    sys.exit(main())
