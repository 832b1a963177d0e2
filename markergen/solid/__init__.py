"""Solids: the marker as a plate with inlaid dots. The only package that imports cadquery, and only inside functions."""
