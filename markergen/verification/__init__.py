"""Verify output files: read them back independently of the code that wrote them, and check every dot."""

from markergen.verification.check import verify
from markergen.verification.result import Check

__all__ = ["Check", "verify"]
