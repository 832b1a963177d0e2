"""Proof that a file has the right size: it is read back by other means than those that wrote it, dot by dot."""

from markergen.verification.check import Check, verify

__all__ = ["Check", "verify"]
