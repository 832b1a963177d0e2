"""Lets ``python -m markergen.cli`` do what ``markergen`` does."""

import sys

from markergen.cli import main

if __name__ == "__main__":
    sys.exit(main())
