"""Names that an option takes one of, for lists in a page and for shells that complete them; loaded when asked for."""
# tests: tests/cli/test_completion.py

from collections.abc import Sequence
from pkgutil import resolve_name

from markergen.options import Option

NAMES: dict[str, Sequence[str]] = {
    "aggregate": ["markergen.objectives.aggregates:AGGREGATES"],
    "background": ["plain", "markergen.render.scenery:BACKGROUNDS"],
    "boundary_unit": ["markergen.read.outlines.formats:UNITS"],
    "colors": ["black", "inverted"],
    "coordinates": ["unit", "metric", "pixel", "hartley"],
    "dome": ["half", "ball"],
    "fit": ["slip", "press"],
    "geometry": ["free", "nominal"],
    "noise_model": ["markergen.model.spec:NOISE_MODELS"],
    "objective": ["markergen.objectives:OBJECTIVES"],
    "orientation": ["portrait", "landscape"],
    "origin": ["center", "file"],
    "paper": ["markergen.drawing.paper:NAMES"],
    "poses": ["markergen.model.poses:POSES"],
    "poses_axes": ["opencv", "opengl"],
    "poses_frame": ["marker-in-camera", "camera-in-marker", "body"],
    "poses_unit": ["mm", "cm", "m", "in", "ft"],
    "process": ["markergen.model.fabrication:PROCESSES"],
    "symmetric": ["none", "any"],
    "template": ["markergen.read.templates:shipped_templates"],
}
"""Names by option, or where a table has them; other values may be possible, too, such as a file or a size of paper."""


def takes_names(option: Option) -> bool:
    """Whether an option takes one of `NAMES`: the poses of a rig have none."""
    return option.name in NAMES and not {"NAME", "UNIT"}.isdisjoint(option.metavar.split("|"))


def names_of(option: str) -> list[str]:
    """Return the names that an option takes, if it is one of `NAMES`.

    >>> names_of("noise_model")
    ['point', 'image']
    """
    names: list[str] = []
    for name in NAMES[option]:
        table = resolve_name(name) if ":" in name else [name]
        names += table() if callable(table) else table
    return names
