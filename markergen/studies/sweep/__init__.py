"""Sweeps: any grid over what decides a marker, its camera and its noise, as one tidy table."""
