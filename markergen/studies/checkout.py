"""Makes the paper's study importable in a checkout, from the examples, whether markergen is installed or not.

The wheel includes it as the package ``markergen_paper`` next to markergen, and needs nothing from this module.
"""

# tests: tests/test_packaging.py

import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from markergen.studies.named import STUDIES

GROUP = "markergen.studies"
FOLDER = Path(__file__).parents[2] / "examples" / "paper_study"

if FOLDER.is_dir():
    # Takes precedence over other places, also in worker processes: the study belongs to this markergen.
    sys.path.insert(0, str(FOLDER))
    if "paper" not in entry_points(group=GROUP).names:
        STUDIES.register("paper")(EntryPoint("paper", "markergen_paper:PAPER", GROUP).load())
