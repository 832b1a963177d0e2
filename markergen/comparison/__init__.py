"""Comparison of markers, tags and boards by synthetic views: contestants, statistics, results."""
