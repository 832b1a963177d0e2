"""The study of Acuna & Willert (2018), reproduced: its experiments, its claims, and extensions.

It uses markergen like any other package, and is registered in the table of studies as ``paper``.
"""

from markergen.studies.named import NamedStudy
from markergen_paper.options import PaperOptions
from markergen_paper.study import estimated_seconds, run_paper

PAPER = NamedStudy(PaperOptions, run_paper, estimated_seconds)

__all__ = ["PAPER", "PaperOptions", "estimated_seconds", "run_paper"]
