"""The study of Acuna & Willert (2018), reproduced: its experiments, its claims, and what lies beyond them."""

from markergen.studies.paper.options import PaperOptions
from markergen.studies.paper.run import estimated_seconds, run_paper

__all__ = ["PaperOptions", "estimated_seconds", "run_paper"]
