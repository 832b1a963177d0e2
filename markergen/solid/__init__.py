"""Solids: the marker as a plate with what a process puts into it, on it, or takes from it.

The only package that imports cadquery, and only inside functions.
"""
