"""What a spec asks for, as objects of a search."""

from dataclasses import replace

from markergen.model.boundary import Boundary, area_without
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize.exchange import fewer


def room_of(spec: Spec) -> Boundary:
    """Where the spec lets dots be: the boundary without its keep-outs and the tag."""
    return area_without(spec.boundary, spec.blocked)


def objective_of(spec: Spec, setting: Setting) -> Objective:
    """The objective that the spec asks for, in a setting."""
    objective = OBJECTIVES[spec.objective](setting, spec.aggregate, spec.coordinates)
    return SurvivalObjective(objective, spec.survive) if spec.survive else objective


def rough_of(spec: Spec, setting: Setting) -> Objective:
    """The same objective for fewer poses."""
    return objective_of(spec, replace(setting, poses=fewer(setting.poses)))
