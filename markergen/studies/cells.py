"""Cells: the independent parts of a study, each named and seeded by what it is about."""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import version
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from markergen import __version__

Result: TypeAlias = dict[str, NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Cell:
    """One part of a study; cells of the same kind and settings are equal, whoever makes them.

    Attributes
    ----------
    kind : str
        What is done.
    settings : mapping
        Plain JSON values that decide, together with the kind, everything about the result; any seed of the study is
        among them.

    Raises
    ------
    TypeError, ValueError
        If a setting is no JSON value, or not finite.
    """

    kind: str
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        # A copy as JSON has it: a tuple is a list, before a cell went to a worker and after.
        object.__setattr__(self, "settings", json.loads(canonical(self.settings)))

    @cached_property
    def key(self) -> str:
        """Canonical JSON of kind and settings."""
        return canonical({"kind": self.kind, "settings": self.settings})

    @cached_property
    def name(self) -> str:
        """16 hexadecimal digits that stand for the key."""
        return self._digest.hex()[:16]

    @cached_property
    def seed(self) -> int:
        """Seed of 128 bits for everything random about this cell: no other cell has it, and no order changes it."""
        return int.from_bytes(self._digest[16:], "big")

    @property
    def rng(self) -> np.random.Generator:
        """A new generator of random numbers from the seed."""
        return np.random.default_rng(self.seed)

    @cached_property
    def _digest(self) -> bytes:
        return hashlib.sha256(self.key.encode()).digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cell) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


Work: TypeAlias = Callable[[Cell], Result]
"""Computes the arrays of a cell, from nothing but the cell; a function of a module, so that other processes find it."""


def canonical(value: Any) -> str:
    """JSON of plain values, the same text for equal values.

    Raises
    ------
    TypeError, ValueError
        If a value is no JSON value, or not finite.
    """
    if isinstance(value, Mapping):
        value = dict(value)
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def versions() -> dict[str, str]:
    """Versions of what cells are computed with: others may give other bits."""
    libraries = {"numpy": "numpy", "scipy": "scipy", "opencv": "opencv-contrib-python-headless"}
    return {"markergen": __version__, **{name: version(package) for name, package in libraries.items()}}
