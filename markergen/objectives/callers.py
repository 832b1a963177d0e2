"""Objectives that a caller passes as they are: a function, or a class of its own."""
# tests: tests/objectives/test_callers.py

import re
from collections.abc import Callable
from typing import Any

from markergen.errors import InputError
from markergen.objectives.autograd import Array, AutogradObjective
from markergen.objectives.base import OBJECTIVES


class FunctionObjective(AutogradObjective):
    """An objective whose values a function computes from the points and the objective itself, as `view`."""

    function: Callable[[Array, AutogradObjective], Array]

    def values(self, points: Array) -> Array:
        """See `AutogradObjective.values`."""
        return type(self).function(points, self)


def objective_name(objective: Any) -> str:
    """Return the name of an objective in the table, where one that is no text is entered under its own name.

    A function takes points (B, n, 2 or 3) in m and a `view`, an `AutogradObjective` with the differentiable
    ``view.covariance(points)``, ``view.information(points)`` and ``view.pixels(points)``, and returns values (B, P)
    above 0, computed with ``autograd.numpy``. A class is a subclass of `Objective`.

    Raises
    ------
    InputError
        If it is none of these, or markergen has an objective of that name.
    """
    if isinstance(objective, str):
        return objective
    name = getattr(objective, "__name__", type(objective).__name__)
    if not callable(objective):
        remedy = "give a name, a function of points and view, or a subclass of Objective"
        raise InputError("an objective", f"objective of type {name}", remedy)
    # A lambda's is <lambda>.
    name = re.sub(r"\W", "", name).lower()
    entry = objective if isinstance(objective, type) else type(name, (FunctionObjective,), {"function": objective})
    OBJECTIVES.take(name, entry)
    return name
