"""Engines: who computes the cells of a study. A new one is a new file."""

from markergen.studies.engines.base import ENGINES, Engine, EngineOptions, engine_for

__all__ = ["ENGINES", "Engine", "EngineOptions", "engine_for"]
