"""Names that an option takes one of, for lists in a page and for shells that complete them; loaded when asked for."""
# tests: tests/cli/test_completion.py

from collections.abc import Callable, Iterable

from markergen.options import Option


def _aggregates() -> Iterable[str]:
    from markergen.objectives.aggregates import AGGREGATES

    return AGGREGATES


def _backgrounds() -> Iterable[str]:
    from markergen.render.scenery import BACKGROUNDS

    return BACKGROUNDS


def _units() -> Iterable[str]:
    from markergen.read.outlines.formats import UNITS

    return UNITS


def _noise_models() -> Iterable[str]:
    from markergen.model.spec import NOISE_MODELS

    return NOISE_MODELS


def _objectives() -> Iterable[str]:
    from markergen.objectives import OBJECTIVES

    return OBJECTIVES


def _poses() -> Iterable[str]:
    from markergen.model.poses import POSES

    return POSES


def _processes() -> Iterable[str]:
    from markergen.model.fabrication import PROCESSES

    return PROCESSES


def _papers() -> Iterable[str]:
    from markergen.drawing.paper import PAPERS

    return (paper.name for paper in PAPERS.values())


def _templates() -> Iterable[str]:
    from markergen.read.templates import shipped_templates

    return shipped_templates()


NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "aggregate": _aggregates,
    "background": lambda: ("plain", *_backgrounds()),
    "boundary_unit": _units,
    "colors": lambda: ("black", "inverted"),
    "coordinates": lambda: ("unit", "metric", "pixel", "hartley"),
    "dome": lambda: ("half", "ball"),
    "fit": lambda: ("slip", "press"),
    "geometry": lambda: ("free", "nominal"),
    "noise_model": _noise_models,
    "objective": _objectives,
    "orientation": lambda: ("portrait", "landscape"),
    "origin": lambda: ("center", "file"),
    "paper": _papers,
    "poses": _poses,
    "poses_axes": lambda: ("opencv", "opengl"),
    "poses_frame": lambda: ("marker-in-camera", "camera-in-marker", "body"),
    "poses_unit": lambda: ("mm", "cm", "m", "in", "ft"),
    "process": _processes,
    "symmetric": lambda: ("none", "any"),
    "template": _templates,
}
"""Names by option; other values may be possible, too, such as a file or a size of paper."""


def takes_names(option: Option) -> bool:
    """Whether an option takes one of `NAMES`: the poses of a rig have none."""
    return option.name in NAMES and not {"NAME", "UNIT"}.isdisjoint(option.metavar.split("|"))


def names_of(option: str) -> list[str]:
    """Return the names that an option takes, if it is one of `NAMES`.

    >>> names_of("noise_model")
    ['point', 'image']
    """
    return list(NAMES[option]())
