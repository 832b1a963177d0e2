"""Where the paper's study is found in a checkout: among the examples, whether markergen is installed or not.

The wheel has it as the package ``markergen_paper`` beside markergen, and nothing to do here.
"""

import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from markergen.studies.named import STUDIES

GROUP = "markergen.studies"
FOLDER = Path(__file__).parents[2] / "examples" / "paper_study"

if FOLDER.is_dir():
    # Before any other place, and for worker processes as well: the study belongs to the markergen it comes with.
    sys.path.insert(0, str(FOLDER))
    if "paper" not in entry_points(group=GROUP).names:
        STUDIES.register("paper")(EntryPoint("paper", "markergen_paper:PAPER", GROUP).load())
