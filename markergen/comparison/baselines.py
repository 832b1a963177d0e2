"""Contestants to compare a marker with: markers in their own size; layouts, tags, boards in that of the first."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from markergen.comparison.contestants import KINDS, Arena, Contestant, forms
from markergen.comparison.contestants.dots import DotBody
from markergen.comparison.contestants.tags import TagBody
from markergen.errors import InputError, among
from markergen.model.body_json import load_marker_or_rig
from markergen.model.boundary import Circle
from markergen.model.marker import Marker, check_supported
from markergen.model.poses import PoseDistribution
from markergen.model.rig import Rig
from markergen.model.spec import Spec
from markergen.objectives import Setting
from markergen.read.poses import poses_from
from markergen.validation.setting import setting_of

DEFAULTS = (
    "ngon", "square", "random", "aruco:DICT_4X4_50", "edges:aruco:DICT_4X4_50", "apriltag:36h11", "charuco:5x5",
    "circles:5x5", "checkerboard:9x9",
)  # fmt: skip
"""Default opponents of a single contestant: one of each that needs no further library."""

_OTHERS = ("acircles:5x5", "pupil:36h11", "ringgrid:4x5", "stag:HD21")
USUAL = {text.partition(":")[0]: text for text in (*DEFAULTS, *_OTHERS)}
"""What the first word of a contestant stands for."""

RIG_DEFAULTS = ("aruco:DICT_4X4_50", "apriltag:36h11")
"""Default opponents of a single rig."""


def line_up(
    texts: Sequence[str],
    poses: str | PoseDistribution | None = None,
    seed: int = 0,
    given: Mapping[str, Marker | Rig] | None = None,
) -> tuple[list[Contestant], Setting]:
    """Make contestants from their texts, with the camera and poses that the first marker file was designed for.

    Other markers keep their size; all else is as large as the circle of the first marker allows, with the white around
    it that it needs. If there are rigs, all are rigs, or tags on each plate of the first one.

    Parameters
    ----------
    texts : sequence of str
        Contestants in the forms of `markergen.comparison.contestants.listed`, or the first word of one of `USUAL`;
        a single one is compared with `DEFAULTS`.
    poses : str, PoseDistribution or None
        Poses to use instead, in any form that `poses_from` accepts.
    seed : int
        Seed for the random layouts.
    given : mapping or None
        Markers that are not in files, by the texts that stand for them.

    Raises
    ------
    InputError
        If a text has none of the forms, a file is not a marker, or a tag does not exist.
    """
    if seed < 0:
        raise InputError("a seed of 0 or more", f"seed={seed}", "give a non-negative whole number")
    if not texts:
        raise InputError("contestants to compare", "none", f"name some: {forms()}")
    bodies = given or {}
    wanted = list(dict.fromkeys(text if text in bodies else USUAL.get(text, text) for text in texts))
    loaded = {
        text: bodies[text] if text in bodies else _read(text)
        for text in wanted
        if text in bodies or text.partition(":")[0] not in KINDS
    }
    rigs = {text: body for text, body in loaded.items() if body.frame == "rig"}
    if rigs:
        return _rig_line_up(wanted, rigs, poses)
    wanted = list(dict.fromkeys([*wanted, *DEFAULTS])) if len(texts) == 1 else wanted
    markers = {text: _visible(text, body) for text, body in loaded.items() if body.frame == "marker"}
    first = next(iter(markers.values()), None)
    judged = setting_of(first, poses) if first else _default_setting(poses)
    # All are judged where the largest circle is visible, whatever their outlines, so that all have the same poses.
    disk = Circle(max([judged.boundary.radius, *(marker.boundary.radius for marker in markers.values())]))
    height = max((marker.height for marker in markers.values()), default=0.0)
    setting = Setting(judged.boundary, judged.camera, judged.poses.seen_whole(disk, judged.camera, height))
    arena = Arena(setting, first, seed)
    contestants: dict[str, Contestant] = {}
    for text in wanted:
        entry = DotBody(text, markers[text]) if text in markers else KINDS[text.partition(":")[0]](text, arena)
        contestants.setdefault(entry.name, entry)
    return list(contestants.values()), setting


def _rig_line_up(
    wanted: Sequence[str], rigs: Mapping[str, Rig], poses: str | PoseDistribution | None
) -> tuple[list[Contestant], Setting]:
    first = next(iter(rigs.values()))
    setting = setting_of(first, poses)
    contestants = list[Contestant]()
    for text in wanted if len(wanted) > 1 else [*wanted, *RIG_DEFAULTS]:
        if text in rigs:
            for plate in rigs[text].markers:
                _visible(f"{plate.name} of {text}", plate.marker)
            contestants.append(DotBody(text, rigs[text]))
        elif text.partition(":")[0] in ("aruco", "apriltag"):
            contestants.append(TagBody.on(first, text))
        else:
            raise InputError(
                "a rig, or a tag on each of its plates", text, "give a rig.json, aruco:DICT or apriltag:FAMILY"
            )
    return contestants, replace(setting, sight=None)


def _read(text: str) -> Marker | Rig:
    path = Path(text)
    if path.suffix.lower() != ".json" and not path.exists():
        raise InputError("a known contestant", repr(text), among(text, [*KINDS, *DEFAULTS], [forms()]))
    return load_marker_or_rig(path)


def _visible(text: str, marker: Marker) -> Marker:
    check_supported(marker, "to compare")
    if min(point.feature.diameter for point in marker.control_points) == 0:
        raise InputError("dots that can be seen", f"a dot of diameter 0 in {text}", "design it with --dot above 0")
    return marker


def _default_setting(poses: str | PoseDistribution | None) -> Setting:
    spec = Spec()
    seen = poses_from(spec.poses if poses is None else poses).seen_whole(spec.boundary, spec.camera)
    return Setting(spec.boundary, spec.camera, seen)
