"""Markers of all kinds as STL, 3MF and GLB: closed, as large as they should be, and with their dots where they are."""

import zipfile
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from io import BytesIO
from xml.etree import ElementTree

import numpy as np
import pytest
from rewritten_solids import meshes_of_3mf
from tetrahedra import mesh_volume

from markergen.exporters import EXPORTERS, ExportOptions, Output
from markergen.model.fabrication import Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Substrate, parse_mount
from markergen.model.tag import Tag
from markergen.solid.primitives import OTHER
from markergen.workshop.formats.meshes import VOLUMES
from markergen.workshop.formats.solids import Designed
from markergen.workshop.mesh import MATERIALS, Mesh, meshed

PLACE = 5e-3
"""mm: what is asked of dot centers in meshes."""

BLANK = {"engrave": False}
KINDS = {
    "plain": (4, False, Fabrication("fdm")),
    "fdm": (5, True, Fabrication("fdm", **BLANK)),
    "cnc": (4, True, Fabrication("cnc", draft=0.05, **BLANK)),
    "laser": (4, True, Fabrication("laser", **BLANK)),
    "print": (5, False, Fabrication("print", **BLANK)),
    "half-balls": (4, True, Fabrication("dome", **BLANK)),
    "balls": (4, False, Fabrication("dome", dome="ball", **BLANK)),
}
"""Number of dots, whether with relief, tag and holes, and how it is made."""


@pytest.fixture(scope="module")
def make(make_ngon) -> Callable[[int, bool], Marker]:
    def made(n: int, rich: bool) -> Marker:
        marker = make_ngon(n, 0.08, 0.01)
        if not rich:
            return marker
        raised = tuple(replace(p, z=0.015 + 0.001 * p.id if p.id % 2 else 0.0) for p in marker.control_points)
        return replace(
            marker,
            control_points=raised,
            tag=Tag("aruco:DICT_6X6_250", 23, 0.03),
            substrate=Substrate(holes=parse_mount("4xM3c@70mm"), chamfer=0.0005),
        )

    return made


@pytest.fixture(scope="module", params=KINDS)
def kind(request, make) -> tuple[Marker, ExportOptions, Designed, tuple[Mesh, ...]]:
    n, rich, fabrication = KINDS[request.param]
    marker, options = make(n, rich), ExportOptions(fabrication=fabrication)
    return marker, options, *meshed([marker], options, ".stl")


def written(kind: tuple[Marker, ExportOptions, Designed, tuple[Mesh, ...]], suffix: str) -> Output:
    return output_of(kind[0], kind[1], suffix)


@lru_cache(maxsize=3)
def output_of(marker: Marker, options: ExportOptions, suffix: str) -> Output:
    return EXPORTERS[suffix]([marker], options)


def test_parts_have_their_volumes(kind):
    _, _, work, meshes = kind
    for part, body in zip(meshes, work.made.parts, strict=True):
        assert part.name == body.name
        # 0.1 % is asked of STL.
        assert mesh_volume(part) == pytest.approx(body.volume, rel=1e-3)


def test_stl_is_watertight_as_a_whole_and_by_material(kind):
    import trimesh

    output, work, parts = written(kind, ".stl"), *kind[2:]
    shells = {material: sum(part.material == material for part in parts) for material in ("light", "dark")}
    files = {len(parts): output.data} | {
        shells[name.removesuffix(".stl").rpartition("-")[2]]: data for name, data in output.beside.items()
    }
    assert len(output.beside) == (2 if all(shells.values()) else 0)
    for count, data in files.items():
        mesh = trimesh.load_mesh(BytesIO(data), file_type="stl")
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        assert mesh.body_count == count
    whole = trimesh.load_mesh(BytesIO(output.data), file_type="stl")
    assert whole.volume == pytest.approx(sum(part.volume for part in work.made.parts), rel=1e-3)


def test_3mf_is_read_without_a_warning(kind):
    output, parts = written(kind, ".3mf"), kind[3]
    several = len({part.material for part in parts}) > 1
    assert list(output.beside) == (["marker-parts.3mf"] if several else [])
    (whole,) = meshes_of_3mf(output.data)
    paints = [triangle.PropertyIDs[0] for triangle in whole.GetAllTriangleProperties()]
    first = 0
    for volume, part in zip(volumes_of_3mf(output.data), parts, strict=True):
        about = {item.get("key"): item.get("value") for item in volume.iter("metadata")}
        assert about == {"name": part.name, "extruder": str(1 + MATERIALS.index(part.material))}
        last = int(volume.get("lastid"))
        assert (int(volume.get("firstid")), last - first + 1) == (first, len(part.triangles))
        # Indices of materials in lib3mf begin at 1.
        ours, other = 1 + MATERIALS.index(part.material), 1 + MATERIALS.index(OTHER[part.material])
        np.testing.assert_array_equal(paints[first : last + 1], np.where(part.marked, other, ours))
        first = last + 1
    assert first == len(paints)
    for data in output.beside.values():
        assert [mesh.GetName() for mesh in meshes_of_3mf(data)] == [part.name for part in parts]


def volumes_of_3mf(data: bytes) -> list[ElementTree.Element]:
    """What PrusaSlicer reads about the parts."""
    with zipfile.ZipFile(BytesIO(data)) as package:
        return ElementTree.fromstring(package.read(VOLUMES)).findall("object/volume")


def test_dots_are_where_they_are_in_stl_3mf_and_glb(kind):
    """Through what other programs read, from the points at a dot's edge, or on its ball."""
    import trimesh

    marker, options, *_ = kind
    if options.fabrication.process == "print":
        return  # has a recess, and no dots
    output = written(kind, ".3mf")
    packed = [
        np.array([list(vertex.Coordinates) for mesh in meshes_of_3mf(data) for vertex in mesh.GetVertices()])
        for data in (output.data, *output.beside.values())
    ]
    scene = trimesh.load_scene(BytesIO(written(kind, ".glb").data), file_type="glb")
    # glTF has y up and m.
    x, up, back = 1e3 * np.concatenate([mesh.vertices for mesh in scene.dump()]).T
    stl = trimesh.load_mesh(BytesIO(written(kind, ".stl").data), file_type="stl").vertices
    for points in (stl, *packed, np.stack([x, -back, up], axis=-1)):
        for dot in marker.control_points:
            center, radius = 1e3 * np.array([dot.x, dot.y, dot.z]), 500 * dot.feature.diameter
            offsets = points - center
            ball = options.fabrication.process == "dome"
            nearby = np.abs(np.linalg.norm(offsets, axis=1) - radius) < 0.05
            on = offsets[nearby & (ball | (np.abs(offsets[:, 2]) < 0.01))]
            # |x - c|^2 = r^2 is linear in c and r^2 - |c|^2.
            left = np.column_stack([2 * on[:, : 3 if ball else 2], np.ones(len(on))])
            fitted = np.linalg.lstsq(left, (on**2).sum(axis=1), rcond=None)[0][:-1]
            assert len(on) > 100
            assert np.abs(fitted).max() < PLACE


def test_a_marker_in_several_formats_is_made_once(make):
    marker, options = make(4, False), ExportOptions(fabrication=Fabrication("print", **BLANK))
    _, first = meshed([marker], options, ".stl")
    assert meshed([replace(marker)], replace(options, stem="other"), ".glb")[1] is first


def test_what_is_engraved_is_said_to_be_light_in_stl(make):
    options = ExportOptions(fabrication=Fabrication("laser", **BLANK))
    assert any("no colors" in note for note in EXPORTERS[".stl"]([make(4, False)], options).notes)


def test_the_tolerance_is_told_and_kept_to(make):
    marker = make(4, False)
    coarse, fine = (
        ExportOptions(fabrication=Fabrication("print", tolerance=tolerance, **BLANK)) for tolerance in (1e-4, 1e-6)
    )
    assert any("100 um" in note for note in EXPORTERS[".stl"]([marker], coarse).notes)
    assert len(EXPORTERS[".stl"]([marker], fine).data) > 2 * len(EXPORTERS[".stl"]([marker], coarse).data)
