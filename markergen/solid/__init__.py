"""Solids of a marker: its plate and what a process inlays, adds, or removes.

The only package that imports cadquery, and only inside functions.
"""
