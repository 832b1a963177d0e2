"""The same suite over every output suffix."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.exporters import EXPORTERS, Exporter, ExportOptions, Output, catalog
from markergen.model.body_json import to_json
from markergen.model.boundary import Circle
from markergen.model.fabrication import Fabrication
from markergen.model.feature import Feature
from markergen.model.marker import build_marker
from markergen.model.tag import Tag

ANGLES = 2 * np.pi * np.arange(5) / 5
MARKER = replace(
    build_marker(
        np.stack([0.03 * np.sin(ANGLES), 0.03 * np.cos(ANGLES), 0 * ANGLES], axis=-1), Circle(0.04), 0.008, 0.0008
    ),
    provenance={"spec_hash": "1a2b3c4d"},
    tag=Tag("apriltag:36h11", 3, 0.012),
)
BARE = replace(MARKER, control_points=tuple(replace(p, feature=Feature(0.0)) for p in MARKER.control_points))
NO_PLACES = {".apriltag.yaml"}
"""What says nothing about the dots."""

NO_WORDS = {".brep"}
"""What has no place for a name."""

SUFFIXES = sorted({EXPORTERS[suffix].write: suffix for suffix in EXPORTERS}.values())
"""One of each exporter."""

OPTIONS = ExportOptions(stem="board", fabrication=Fabrication(engrave=False))
"""What is engraved takes the kernel longer than all else, and is looked at in tests/solid."""

OTHER_PROCESS = """
import sys
from pathlib import Path
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.model.fabrication import Fabrication
from markergen.model.body_json import from_json
marker, options = from_json(sys.stdin.read()), ExportOptions(stem="board", fabrication=Fabrication(engrave=False))
for suffix in sys.argv[2:]:
    Path(sys.argv[1], f"board{suffix}").write_bytes(EXPORTERS[suffix]([marker], options).data)
"""


@pytest.fixture(scope="module")
def outputs():
    """Of every suffix: one after the other, so that solids and meshes are made once."""
    return {suffix: EXPORTERS[suffix]([MARKER], OPTIONS) for suffix in SUFFIXES}


@pytest.fixture(scope="module")
def others():
    """Of markers that differ from that of `outputs` in next to nothing."""
    first, *rest = MARKER.control_points
    moved = replace(MARKER, control_points=(replace(first, x=first.x + 1e-5), *rest))
    tagged = replace(MARKER, tag=replace(MARKER.tag, id=4))
    return {suffix: EXPORTERS[suffix]([tagged if suffix in NO_PLACES else moved], OPTIONS) for suffix in SUFFIXES}


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory):
    """Folder with what another process writes, where sets have another order."""
    folder = tmp_path_factory.mktemp("elsewhere")
    arguments = [sys.executable, "-c", OTHER_PROCESS, str(folder), *SUFFIXES]
    subprocess.run(arguments, input=to_json(MARKER), check=True, env={**os.environ, "PYTHONHASHSEED": "4"})
    return folder


@pytest.fixture(scope="module", params=SUFFIXES)
def suffix(request):
    return request.param


@pytest.fixture(scope="module")
def output(suffix, outputs):
    return outputs[suffix]


def test_suffixes_are_lower_case_with_a_dot(suffix):
    assert suffix.startswith(".")
    assert suffix == suffix.lower()


def test_says_what_it_is_for_in_a_list_of_all(suffix):
    exporter = EXPORTERS[suffix]
    assert isinstance(exporter, Exporter)
    assert (suffix, exporter.description) in [(item, phrase) for suffixes, phrase in catalog() for item in suffixes]
    assert exporter.description == exporter.description.strip(" .")
    assert not (exporter.many_pages and not exporter.sheet)
    assert exporter.holds == "flat" or not exporter.sheet


def test_gives_bytes_and_sentences(output):
    assert isinstance(output, Output)
    assert len(output.data) > 300
    assert all(note.endswith(".") and note[0].isupper() for note in output.notes)


def test_what_comes_with_it_lies_beside_it_and_is_named_after_it(output):
    for name, data in output.beside.items():
        path = PurePosixPath(name)
        assert not path.is_absolute()
        assert ".." not in path.parts
        assert "board" in path.name or name == "model.config"
        assert len(data) > 300


def test_same_bytes_again_in_this_process_and_in_another(suffix, output, elsewhere, tmp_path, monkeypatch):
    assert (elsewhere / f"board{suffix}").read_bytes() == output.data
    monkeypatch.chdir(tmp_path)
    again = EXPORTERS[suffix]([MARKER], OPTIONS)
    assert again.data == output.data
    assert dict(again.beside) == dict(output.beside)


def test_another_marker_gives_other_bytes(suffix, output, others):
    assert others[suffix].data != output.data


def test_bare_points_are_refused_by_drawings_and_solids(suffix):
    if EXPORTERS[suffix].holds == "points":
        assert EXPORTERS[suffix]([BARE], ExportOptions()).data
    else:
        with pytest.raises(InputError, match="diameter 0"):
            EXPORTERS[suffix]([BARE], ExportOptions())


def test_a_relief_is_refused_by_what_is_flat(suffix):
    first, *rest = MARKER.control_points
    raised = replace(MARKER, control_points=(replace(first, z=0.01), *rest))
    if EXPORTERS[suffix].holds == "flat":
        with pytest.raises(InputError, match="a flat marker"):
            EXPORTERS[suffix]([raised], ExportOptions())
    elif EXPORTERS[suffix].holds == "points":
        assert EXPORTERS[suffix]([raised], ExportOptions()).data


def test_no_place_in_the_bytes(output):
    assert b"/tmp" not in output.data
    assert str(Path.cwd()).encode() not in output.data


def test_several_markers_go_on_sheets_alone(suffix):
    second = replace(MARKER, tag=replace(MARKER.tag, id=4))
    if EXPORTERS[suffix].sheet:
        one, two = (EXPORTERS[suffix](markers, ExportOptions()).data for markers in ([MARKER], [MARKER, second]))
        assert one != two
    else:
        with pytest.raises(InputError, match="one marker for"):
            EXPORTERS[suffix]([MARKER, second], ExportOptions())


def test_the_spec_is_named(suffix, output):
    assert (b"1a2b3c4d" in output.data) == (suffix not in NO_WORDS)
