"""Synthetic views: the dots of a marker as a camera images them, through given optics, with given noise."""

from markergen.render.optics import DEFAULT_OPTICS, Optics
from markergen.render.view import render_view

__all__ = ["DEFAULT_OPTICS", "Optics", "render_view"]
