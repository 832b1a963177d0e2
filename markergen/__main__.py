"""Makes ``python -m markergen`` equivalent to ``markergen``."""

import sys

from markergen.cli import main

if __name__ == "__main__":
    sys.exit(main())
