"""From a layout to a marker: numbered dots, their provenance, and the members of a family."""
# tests: tests/optimize/test_design.py

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from markergen import __version__
from markergen.arrays import Array
from markergen.bounds.confusion.perspective import LabelSafety
from markergen.errors import InputError
from markergen.model.marker import Marker, build_marker
from markergen.model.recorded_poses import MOST_KEPT, RecordedPoses
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.objectives.criteria import Criteria
from markergen.optimize.dot_size import DotSize
from markergen.units import NEGLIGIBLE


def numbered(points: Array) -> Array:
    """Sort control points (n, 2 or 3) for labeling: counterclockwise from straight up, those at the center last."""
    radius = np.hypot(points[:, 0], points[:, 1])
    central = radius < 1e-3 * radius.max()
    angle = np.mod(np.arctan2(points[:, 1], points[:, 0]) - np.pi / 2 + 1e-6, 2 * np.pi)
    return points[np.lexsort((radius, np.where(central, 7.0, angle)))]


def dress(
    points: Array,
    dots: DotSize,
    spec: Spec,
    setting: Setting,
    table: dict[str, Criteria],
    labels: LabelSafety | None = None,
) -> Marker:
    """Make a marker from a layout (n, 2 or 3), with its provenance.

    Dot 0 is the key ring and the others are disks; all are disks where the layout alone identifies them.
    """
    # A tenth of a nanometer is far below any manufacturing tolerance, and the file stays readable.
    rounded = np.where(np.abs(points) < NEGLIGIBLE, 0.0, np.round(points, 10))
    return replace(
        build_marker(rounded, spec.boundary, dots.diameter, dots.clearance, keyed=not spec.asymmetric),
        keep_outs=spec.keep_outs,
        tag=spec.placed_tag,
        substrate=spec.substrate,
        provenance={
            **provenance_of(spec, setting, dots.reason, table),
            **({"labels": labels.sentence} if labels else {}),
            # If absent, criteria are for noise of 1 px.
            **({"noise": setting.noise_words} if setting.noise else {}),
        },
    )


def provenance_of(spec: Spec, setting: Setting, dots: str, table: Mapping[str, Criteria]) -> dict[str, Any]:
    """How a marker was designed: the spec, the poses of the setting, what explains its dots, and its criteria."""
    import scipy

    # Of a file with too many poses, only those that the marker was designed for are stored.
    many, seen = isinstance(spec.poses, RecordedPoses) and len(spec.poses) > MOST_KEPT, setting.poses
    stored = (replace(spec, poses=seen) if many and isinstance(seen, RecordedPoses) else spec).as_dict()
    return {
        "spec": stored,
        "spec_hash": spec.hash,
        "seed": spec.seed,
        "versions": {"markergen": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
        "camera": stored["camera"],
        "poses": {"name": setting.poses.name, "count": len(setting.poses), "dropped": setting.poses.dropped},
        "dots": dots,
        "criteria": {
            # JSON has no infinity, which is the homography error of some random layouts.
            name: {key: float(f"{value:.8g}") for key, value in row.items() if np.isfinite(value)}
            for name, row in table.items()
        },
    }


def members(marker: Marker, spec: Spec, ids: Sequence[int]) -> tuple[Marker, ...]:
    """Markers of the same layout with the given tag ids, each as if it had been designed separately.

    Parameters
    ----------
    marker : Marker
        Marker designed from `spec`; the id of its tag does not matter.

    Raises
    ------
    InputError
        If it has no tag, or an id is not in the tag's family.
    """
    if marker.tag is None:
        raise InputError("a tag to tell the markers of a family apart", "none", "add --tag aruco:DICT_4X4_50, say")
    markers = []
    for number in ids:
        tag = replace(marker.tag, id=number)
        member_spec = replace(spec, tag=str(tag))
        stored = {**marker.provenance["spec"], "tag": str(tag)}
        provenance = {**marker.provenance, "spec": stored, "spec_hash": member_spec.hash}
        markers.append(replace(marker, tag=tag, provenance=provenance))
    return tuple(markers)
