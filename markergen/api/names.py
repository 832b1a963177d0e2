"""Names that an option takes one of, for lists in a page and for shells that complete them; loaded when asked for."""

from collections.abc import Callable, Iterable
from importlib import import_module


def _table(module: str, name: str) -> Callable[[], Iterable[str]]:
    return lambda: getattr(import_module(f"markergen.{module}"), name)


def _papers() -> Iterable[str]:
    from markergen.drawing.paper import PAPERS

    return (paper.name for paper in PAPERS.values())


def _templates() -> Iterable[str]:
    from markergen.read.templates import templates

    return templates()


NAMES: dict[str, Callable[[], Iterable[str]]] = {
    "aggregate": _table("objectives.aggregates", "AGGREGATES"),
    "background": lambda: ("plain", *_table("render.scenery", "BACKGROUNDS")()),
    "boundary_unit": _table("read.outlines.formats", "UNITS"),
    "colors": lambda: ("black", "inverted"),
    "coordinates": lambda: ("unit", "metric", "pixel", "hartley"),
    "dome": lambda: ("half", "ball"),
    "fit": lambda: ("slip", "press"),
    "geometry": lambda: ("free", "nominal"),
    "noise_model": _table("model.spec", "NOISE_MODELS"),
    "objective": _table("objectives", "OBJECTIVES"),
    "orientation": lambda: ("portrait", "landscape"),
    "origin": lambda: ("center", "file"),
    "paper": _papers,
    "poses": _table("model.poses", "POSES"),
    "process": _table("model.fabrication", "PROCESSES"),
    "refine": _table("detect.photometric", "REFINEMENTS"),
    "template": _templates,
}
"""Names by option; other values may be possible, too, such as a file or a size of paper."""


def names_of(option: str) -> list[str]:
    """Return the names that an option takes, if it is one of `NAMES`.

    >>> names_of("noise_model")
    ['point', 'image']
    """
    return list(NAMES[option]())
