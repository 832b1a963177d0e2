"""Synthetic views: camera images of flat patches, with scenery, optics and noise."""

from markergen.render.optics import DEFAULT_OPTICS, Optics, optics_from_text
from markergen.render.patches import Patch, circle_polygon
from markergen.render.scenery import Scenery
from markergen.render.view import expected_levels, render_patches, render_view, seen_patches, window_of

render_rig = render_view
"""Another name of `render_view`, which renders rigs as well; for this release."""
circle = circle_polygon
"""Another name of `circle_polygon`; for this release."""

__all__ = [
    "DEFAULT_OPTICS",
    "Optics",
    "Patch",
    "Scenery",
    "circle",
    "circle_polygon",
    "expected_levels",
    "optics_from_text",
    "render_patches",
    "render_rig",
    "render_view",
    "seen_patches",
    "window_of",
]
