"""The accuracy of a marker: noisy trials against the bounds, synthetic views, comparisons, and checks of the results."""
