"""Work for studies that takes no time worth speaking of, importable in worker processes."""

import os
import time

import numpy as np

from markergen.errors import InputError
from markergen.studies.cells import Cell


def cells(count):
    return [Cell("noise", {"index": index, "seed": 7}) for index in range(count)]


def noise(cell):
    """Random numbers of the cell's own, and a matrix product, which threads of BLAS may add up in another order."""
    values = cell.rng.standard_normal((60, 60))
    return {"values": values, "product": values @ values.T, "index": np.array(cell.settings["index"])}


def slow_noise(cell):
    time.sleep(0.05)
    return noise(cell)


def refusing(cell):
    if cell.settings["index"] == 3:
        raise InputError("an index below 3", "index=3", "leave it out")
    return noise(cell)


def dying(cell):
    os._exit(1)
