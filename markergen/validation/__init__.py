"""Accuracy of a marker: noisy trials against bounds, synthetic views, comparisons, and checks of results."""
