"""Solids as cadquery's shapes, whose volumes, boxes, faces and Booleans do not depend on how they were built."""

from collections.abc import Sequence
from dataclasses import replace

from markergen.solid.primitives import Part
from markergen.workshop.formats import solids
from markergen.workshop.formats.solids import NamedSolid


def build(part: Part) -> NamedSolid:
    """Build one part."""
    return solids_of([part])[0]


def solids_of(parts: Sequence[Part]) -> list[NamedSolid]:
    """Build all parts."""
    return [shown(solid) for solid in solids.solids_of(tuple(parts))]


def shown(solid: NamedSolid) -> NamedSolid:
    """The same solid for cadquery."""
    import cadquery

    return replace(solid, shape=cadquery.Shape.cast(solid.shape), marked=tuple(map(cadquery.Shape.cast, solid.marked)))
