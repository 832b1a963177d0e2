"""Makes ``python -m markergen.cli`` equivalent to ``markergen``."""

import sys

from markergen.cli import main

if __name__ == "__main__":
    sys.exit(main())
