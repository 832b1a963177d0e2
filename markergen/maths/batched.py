"""Base of dataclasses whose attributes are arrays with one first axis: many things of a kind."""
# tests: tests/bounds/confusion/test_rival_fits.py tests/calibration/test_adjustment.py

from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray


class Batched:
    """B things of a kind: a dataclass of arrays (B, ...).

    >>> from dataclasses import dataclass
    >>> @dataclass
    ... class Points(Batched):
    ...     x: np.ndarray
    ...     y: np.ndarray
    >>> points = Points(np.array([1, 2, 3]), np.array([4, 5, 6]))
    >>> points.take(np.array([True, False, True])).joined(points.take(slice(1))).x
    array([1, 3, 1])
    """

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __len__(self) -> int:
        return len(self._arrays[0])

    @property
    def _arrays(self) -> list[NDArray[Any]]:
        return [getattr(self, name) for name in self.__dataclass_fields__]

    def take(self, chosen: NDArray[np.intp] | NDArray[np.bool_] | slice) -> Self:
        """Return a subset."""
        return type(self)(*(array[chosen] for array in self._arrays))

    def joined(self, others: Self) -> Self:
        """Return these, then the others."""
        return type(self)(*map(np.concatenate, zip(self._arrays, others._arrays, strict=True)))

    def put(self, index: NDArray[np.intp], others: Self) -> Self:
        """Return a copy with others in the place of some."""
        copies = [array.copy() for array in self._arrays]
        for copy, array in zip(copies, others._arrays, strict=True):
            copy[index] = array
        return type(self)(*copies)
