"""Sweeps: any grid over what decides a marker, its camera and its noise, as one tidy table."""

from markergen.studies.sweep.grid import Sweep, read_sweep, studies, sweep_from_mapping
from markergen.studies.sweep.run import run_sweep

__all__ = ["Sweep", "read_sweep", "run_sweep", "studies", "sweep_from_mapping"]
