"""Table of objectives: the functions of the layout that a design minimizes, each with its gradient.

An entry is a class registered in `OBJECTIVES` by a module of this package; it is built from a `Setting`.
"""

from markergen.objectives.base import OBJECTIVES, Criterion, Objective, Setting

__all__ = ["OBJECTIVES", "Criterion", "Objective", "Setting"]
