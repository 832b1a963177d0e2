"""A word of a file that is misspelled, left out or doubled changes nothing, or is refused or reported: never silent."""

import re
from dataclasses import fields

import numpy as np
import pytest
from camera_programs import CAMERAS
from outline_programs import OUTLINES
from pose_programs import POSES
from rigs import corner

from markergen.api.shipped import template_plan
from markergen.errors import InputError
from markergen.geometry.contour import area
from markergen.model.body_json import load_rig, rig_to_json
from markergen.model.rig import Rig
from markergen.read.cameras import read_camera
from markergen.read.outlines.boundary import read_contours
from markergen.read.poses import read_poses
from markergen.read.poses.conventions import PoseConvention
from markergen.read.remarks import collected_remarks, remark
from markergen.read.templates import shipped_templates, template_text

RAYS = np.random.default_rng(0).uniform(-0.4, 0.4, (20, 2))


def camera(path, row):
    read = read_camera(f"{path}{row[2]}")
    return np.append(np.nan_to_num(read.to_pixels(RAYS)).ravel(), [read.width, read.height])


def poses(path, row):
    read = read_poses(path, PoseConvention(**row[1]))
    if doubt := read.plausibility():
        remark(doubt)
    return np.concatenate([read.rotation.ravel(), read.translation.ravel()])


def outline(path, row):
    contours = read_contours(path, **row[2])
    return np.array([sum(map(area, contours)), len(contours)])


def spec(path, row):
    read, choices, shape = template_plan(str(path))
    plates = shape and [(face.name, face.rotation, face.translation, str(face.boundary)) for face in shape.faces]
    values = [repr(getattr(read, field.name)) for field in fields(read) if field.name != "title"]
    return [*values, repr((choices, plates))]


def rig(path, row):
    """All of a rig but its labels."""
    read = load_rig(path)
    labels = ("provenance", "extensions")
    parts = [[getattr(plate.marker, field.name) for field in fields(plate.marker) if field.name not in labels]
             for plate in read.markers]  # fmt: skip
    return [
        repr((plate.rotation, plate.translation, part)) for plate, part in zip(read.markers, parts, strict=True)
    ] + [repr(read.relation)]


MEASURED = Rig(corner(inward=True).markers, tuple(map(tuple, (1e-8 * np.eye(12)).tolist())))
RIGS = {"corner": (rig_to_json(MEASURED).decode(),)}
SPECS = {name: (template_text(name),) for name in shipped_templates()}
READERS = {"camera": (CAMERAS, camera), "poses": (POSES, poses), "outline": (OUTLINES, outline), "spec": (SPECS, spec),
           "rig": (RIGS, rig)}  # fmt: skip
WORD = re.compile(r"(?<![\w.])[A-Za-z_][A-Za-z_.\-]*[A-Za-z_]")


def span(text):
    """Where words are changed: of a DXF in its blocks and entities, since all have the same header and tables."""
    start, end = text.find("\nBLOCKS\n"), text.find("\nENDSEC", text.find("\nENTITIES\n"))
    is_first = text == OUTLINES["lwpolyline mm"][0]
    return (start, end) if 0 <= start < end and not is_first else (0, len(text))


def misspelled(text):
    """Yield texts with one word changed: a letter left out, doubled, or exchanged with the next."""
    for match in WORD.finditer(text, *span(text)):
        word, middle = match[0], len(match[0]) // 2
        for other in (
            word[:middle] + word[middle + 1 :],
            word[: middle + 1] + word[middle:],
            word[: middle - 1] + word[middle] + word[middle - 1] + word[middle + 1 :],
        ):
            if other != word:
                yield text[: match.start()] + other + text[match.end() :], f"{word} -> {other}"


def result_of(path, kind, row, text):
    """Return what is read and the remarks, or None if it is refused."""
    path = path.with_suffix(".toml" if kind == "spec" else "")
    path.write_text(text)
    with collected_remarks() as remarks:
        try:
            return READERS[kind][1](path, row), remarks
        except InputError:
            return None, remarks


def is_close(after, before):
    return after.shape == before.shape and np.allclose(after, before, rtol=1e-9, atol=1e-9)


def silent(path, kind, name, step=1):
    """Return the changes that are accepted, give something else, and are not reported; and the number tried."""
    row = READERS[kind][0][name]
    if not isinstance(row[0], str):
        return [], 0
    before, message = result_of(path, kind, row, row[0])
    changes, count = [], 0
    for text, change in list(misspelled(row[0]))[::step] if before is not None else []:
        after, remarks = result_of(path, kind, row, text)
        count += 1
        same = after == before if isinstance(before, list) else after is not None and is_close(after, before)
        if after is not None and not same and len(remarks) <= len(message) and remarks == message:
            changes.append(change)
    return changes, count


@pytest.mark.parametrize("kind", READERS)
def test_some_changes_are_never_silent(tmp_path, kind):
    for index, name in enumerate(READERS[kind][0]):
        changes, _ = silent(tmp_path / "file", kind, name, 59 + index % 7)
        assert not changes, name


@pytest.mark.long
@pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind, (files, _) in READERS.items() for name in files])
def test_no_change_of_a_word_is_silent(tmp_path, kind, name):
    # Of thousands of words of a DXF, most are those of its header.
    changes, _ = silent(tmp_path / "file", kind, name, max(1, len(READERS[kind][0][name][0]) // 10_000))
    assert not changes
