"""Types of arrays, named once."""
# tests: tests/bounds/confusion/test_affine.py tests/bounds/confusion/test_perspective.py

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Indices = NDArray[np.intp]
