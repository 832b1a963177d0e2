"""Solids of a marker: its plate and what a process inlays, adds, or removes.

The only package that imports Open CASCADE (OCP), and only inside functions.
"""
