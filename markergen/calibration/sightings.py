"""What the photographs of a calibration show: labeled dots of each marker in each photograph, and what was not used."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from markergen.calibration.network import Views

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Sightings:
    """Labeled dots of all markers in all photographs; the dots of the markers are numbered one after the other.

    Attributes
    ----------
    photos : tuple of str
        Names of all photographs, used or not.
    size : (width, height), px
    views : Views
        One for each marker seen in a photograph; dots of other markers are not seen.
    photo, marker : arrays (v,) of int
        Photograph and marker of each view.
    unused : mapping of photograph to reason
        Photographs without a view, by index.
    doubts : tuple of str
        What is uncertain about labels, as sentences.
    notes : tuple of str
        Remarks on the files, as sentences: what is not read, or not as it is stored.
    """

    photos: tuple[str, ...]
    size: tuple[int, int]
    views: Views
    photo: NDArray[np.intp]
    marker: NDArray[np.intp]
    unused: dict[int, str] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
