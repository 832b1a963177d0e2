"""Finds the markers of markergen in an image: labeled dots, pose and covariance by one compiled call."""
