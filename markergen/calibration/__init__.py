"""Calibration of a print, and of the camera if asked, from photographs of it."""
