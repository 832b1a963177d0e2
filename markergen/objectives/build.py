"""The objective that a spec asks for."""

from markergen.model.spec import Spec
from markergen.objectives.base import OBJECTIVES, Objective, Setting
from markergen.objectives.survive import SurvivalObjective


def objective_of(spec: Spec, setting: Setting) -> Objective:
    """The spec's objective in a setting, with its aggregate and coordinates, after the worst loss of `survive` dots.

    Raises
    ------
    InputError
        If a name in the spec is unknown.
    """
    objective = OBJECTIVES[spec.objective](setting, spec.aggregate, spec.coordinates)
    return SurvivalObjective(objective, spec.survive) if spec.survive else objective
