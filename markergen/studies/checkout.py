"""Where the paper's study is found in a checkout: among the examples, whether markergen is installed or not.

The wheel has it as the package ``markergen_paper`` beside markergen, and nothing to do here.
"""

import sys
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path

from markergen.studies.named import STUDIES

FOLDER = Path(__file__).parents[2] / "examples" / "paper_study"

if FOLDER.is_dir():
    # Before any other place, and for worker processes as well: the study belongs to the markergen it comes with.
    sys.path.insert(0, str(FOLDER))
    if "paper" not in entry_points(group="markergen.studies").names:
        STUDIES.register("paper")(import_module("markergen_paper").PAPER)
