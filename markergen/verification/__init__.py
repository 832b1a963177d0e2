"""Verify output files: read them back independently of the code that wrote them, and check every dot."""

from markergen.verification.check import Check, verify

__all__ = ["Check", "verify"]
