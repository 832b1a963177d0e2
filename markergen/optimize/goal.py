"""What a spec asks for, as objects of a search."""

from dataclasses import replace

from markergen.errors import InputError
from markergen.model.boundary import Boundary, area_without
from markergen.model.spec import Spec
from markergen.objectives import OBJECTIVES, Objective, Setting
from markergen.objectives.base import either
from markergen.objectives.survive import SurvivalObjective
from markergen.optimize.exchange import fewer


def room_of(spec: Spec) -> Boundary:
    """Where the spec lets dots be: the boundary without its keep-outs and the tag."""
    return area_without(spec.boundary, spec.blocked)


def objective_of(spec: Spec, setting: Setting) -> Objective:
    """The objective that the spec asks for, in a setting.

    Raises
    ------
    InputError
        If there is none of that name, or the spec asks for what it does not know: a relief, or the noise of an image.
    """
    kind = OBJECTIVES[spec.objective]
    if spec.relief and kind.planar_only:
        raise InputError(
            "an objective for points in space with a relief",
            f"objective={spec.objective!r}",
            f"use --objective {either(name for name in OBJECTIVES if not OBJECTIVES[name].planar_only)}",
        )
    if setting.noise and not kind.knows_noise:
        raise InputError(
            "an objective that depends on the noise",
            f"objective={spec.objective!r} with the noise model image",
            f"use --objective {either(name for name in OBJECTIVES if OBJECTIVES[name].knows_noise)}",
        )
    objective = kind(setting, spec.aggregate, spec.coordinates)
    return SurvivalObjective(objective, spec.survive) if spec.survive else objective


def rough_of(spec: Spec, setting: Setting) -> Objective:
    """The same objective for fewer poses."""
    return objective_of(spec, replace(setting, poses=fewer(setting.poses)))
