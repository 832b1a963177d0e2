"""Projection, rotation, DLT, conics and Fisher information: pure batched functions, no I/O, no state."""
