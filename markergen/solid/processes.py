"""Deprecated name of `markergen.workshop.processes`; it goes with the next release."""
# tests: tests/contracts/test_plugins.py

from markergen.solid import moved_module

__getattr__ = moved_module("markergen.workshop.processes")
