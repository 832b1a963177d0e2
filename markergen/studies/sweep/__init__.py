"""Sweeps: grids over the parameters of a marker, its camera and its noise, with results in one tidy table."""
