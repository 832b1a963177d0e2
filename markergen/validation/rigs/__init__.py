"""Validation of rigs: bounds, noisy trials, synthetic views, and the report."""
