"""Plane geometry without units: closed contours of straight lines and arcs."""
