"""Synthetic views: camera images of flat patches, with scenery, optics and noise."""

from markergen.render.optics import DEFAULT_OPTICS, Optics, optics_from_text
from markergen.render.patches import Patch, circle
from markergen.render.rig_view import render_rig
from markergen.render.scenery import Scenery
from markergen.render.view import expected_levels, marker_patches, render_patches, render_view, seen_patches, window_of

__all__ = [
    "DEFAULT_OPTICS",
    "Optics",
    "Patch",
    "Scenery",
    "circle",
    "expected_levels",
    "marker_patches",
    "optics_from_text",
    "render_patches",
    "render_rig",
    "render_view",
    "seen_patches",
    "window_of",
]
