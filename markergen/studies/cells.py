"""Cells: the independent parts of a study, named and seeded by their settings."""

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
    """Part of a study; cells of equal kind and settings are equal.

    Attributes
    ----------
    kind : str
        Kind of work.
    settings : mapping
        Plain JSON values that, together with the kind, fully determine the result, including any seed of the study.

    Raises
    ------
    TypeError, ValueError
        If a setting is not a JSON value, or not finite.
    """

    kind: str
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        # A copy through JSON, so that tuples are lists both before and after transfer to a worker.
        object.__setattr__(self, "settings", json.loads(canonical_text(self.settings)))

    @cached_property
    def key(self) -> str:
        """Canonical JSON of kind and settings."""
        return canonical_text({"kind": self.kind, "settings": self.settings})

    @cached_property
    def name(self) -> str:
        """16 hexadecimal digits derived from the key."""
        return self._digest.hex()[:16]

    @cached_property
    def seed(self) -> int:
        """128-bit seed for all random numbers of this cell, unique to it and independent of the order of cells."""
        return int.from_bytes(self._digest[16:], "big")

    @property
    def rng(self) -> np.random.Generator:
        """New random generator with this seed."""
        return np.random.default_rng(self.seed)

    @cached_property
    def _digest(self) -> bytes:
        return hashlib.sha256(self.key.encode()).digest()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Cell) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


Work: TypeAlias = Callable[[Cell], Result]
"""Computes the arrays of a cell from the cell alone; a module-level function, so that other processes can import it."""


def canonical_text(value: Any) -> str:
    """JSON of plain values, with equal text for equal values.

    Raises
    ------
    TypeError, ValueError
        If a value is not a JSON value, or not finite.
    """
    if isinstance(value, Mapping):
        value = dict(value)
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)


def versions() -> dict[str, str]:
    """Versions of the software that computes cells, because other versions may produce other bits."""
    libraries = {"numpy": "numpy", "scipy": "scipy", "opencv": "opencv-contrib-python-headless"}
    return {"markergen": __version__, **{name: version(package) for name, package in libraries.items()}}
