"""Deprecated name of `markergen.workshop.manufacturability`; it goes with the next release."""
# tests: tests/contracts/test_plugins.py

from markergen.solid import renamed

__getattr__ = renamed("markergen.workshop.manufacturability")
