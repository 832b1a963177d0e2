"""What all configurations have in common: the marker as points in m, and the words that say what they are about."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import markergen
from markergen.model.marker import Marker, marker_name

Array = NDArray[np.float64]

FRAME = (
    "Frame: the marker's, x right, y up, z out of the printed face toward the viewer.",
    "Unit: m.",
)


def heading(marker: Marker, title: str, *remarks: str) -> str:
    """Comment lines that say which marker this is, its frame and unit, and what else there is to know."""
    name = f"Marker {marker_name(marker)}: {len(marker)} dots, written by markergen {markergen.__version__}."
    corrected = () if marker.as_designed is marker else ("Places are those measured on the print.",)
    return "".join(f"# {line}\n" for line in (title, name, *FRAME, *corrected, *remarks))


def frame_name(marker: Marker) -> str:
    """``markergen_<spec hash>`` of letters, digits and ``_``: a name for frames and nodes."""
    return "".join(letter if letter.isalnum() else "_" for letter in marker_name(marker))


def points(marker: Marker) -> list[list[float]]:
    """Places (n, 3) of the control points in m, in the order of `ids`: as in marker.json, to the last bit."""
    return [[point.x, point.y, point.z] for point in marker.control_points]


def ids(marker: Marker) -> list[int]:
    """Identifiers of the control points."""
    return [point.id for point in marker.control_points]


def diameters(marker: Marker) -> list[float]:
    """Diameters of the dots in m."""
    return [point.feature.diameter for point in marker.control_points]


def tag_corners(marker: Marker) -> list[list[float]]:
    """Corners (4, 3) of the tag's black square in the print, m: top left, top right, bottom right, bottom left."""
    if marker.tag is None:
        return []
    return [[*map(picometers, corner), 0.0] for corner in marker.tag.corners * marker.print_scale]


def picometers(meters: float) -> float:
    """Length in m rounded to 1e-12, so that 0.02 does not read 0.020000000000000004; never -0."""
    return round(float(meters), 12) + 0.0


def yaml_text(value: Mapping[str, Any]) -> str:
    """YAML of plain values, in the order given, the innermost lists and mappings on one line."""
    import yaml

    return str(yaml.safe_dump(dict(value), sort_keys=False, default_flow_style=None, width=110))
