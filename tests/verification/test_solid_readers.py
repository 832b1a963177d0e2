"""What stands in files of solids, and one line about those that lie."""

import json
import re
import struct
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from sentences import sentence
from spoiled_solids import glb, gltf, model, stl, with_model

from markergen import guard
from markergen.errors import InputError, MissingLibraryError
from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.verification import solid_files, verify
from markergen.verification.check import verify_all
from markergen.verification.rims import Rims, dots_of, rims_of
from markergen.verification.solid_files import open_edges
from markergen.workshop.formats.meshes import VOLUMES
from markergen.workshop.processes import parts_of
from tests.support.cad_parts import cad_parts

SMALL = Fabrication(engrave=False, tolerance=1e-5)


@pytest.fixture(scope="module")
def marker(make_ngon):
    return make_ngon(4, 0.05, 0.012)


@pytest.fixture(scope="module")
def data(marker, tmp_path_factory):
    """Bytes of the marker's file by suffix."""
    folder = tmp_path_factory.mktemp("data")
    suffixes = (".step", ".brep", ".stl", ".3mf", ".glb")
    save(marker, [folder / f"a{suffix}" for suffix in suffixes], ExportOptions(fabrication=SMALL))
    return {suffix: (folder / f"a{suffix}").read_bytes() for suffix in (*suffixes, "-parts.3mf")}


def test_names_colors_and_volumes_of_a_step(marker, data):
    parts = parts_of(marker, SMALL).parts
    cad = cad_parts(data[".step"])
    assert [part.name for part in cad] == [part.name for part in parts]
    for part, wanted in zip(cad, parts, strict=True):
        assert not part.flawed
        # What the writer's fifteen digits leave of closed forms.
        assert part.volume == pytest.approx(wanted.volume, rel=1e-9)
        assert part.color == pytest.approx((1, 1, 1) if wanted.material == "light" else (0.05, 0.05, 0.05), abs=1e-6)
    ring = cad[[part.name for part in cad].index("dot-0")]
    place = 1e3 * marker.xyz[0]
    rims = rims_of(ring.corners)
    top = np.flatnonzero(rims.normals[:, 2] > 0.5)
    np.testing.assert_allclose(rims.centers[top], [place, place], atol=1e-7)
    np.testing.assert_allclose(np.sort(rims.radii[top]), [3, 6], atol=1e-7)
    bare = cad_parts(data[".brep"], "BREP")
    assert [part.volume for part in bare] == pytest.approx([part.volume for part in cad], rel=1e-9)
    assert {(part.name, part.color) for part in bare} == {("", None)}


def refused(marker, folder, suffix, content):
    """The one line about a file."""
    path = folder / f"bad{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError) as error:
        verify(marker, path)
    assert len(str(error.value).splitlines()) == 1
    return str(error.value)


def test_stl_that_lie(marker, data, tmp_path):
    good = data[".stl"]
    assert "header implies" in refused(marker, tmp_path, ".stl", good[:-1])
    assert "header implies" in refused(marker, tmp_path, ".stl", good[:80] + b"\xff" * 4 + good[84:])
    assert "found none" in refused(marker, tmp_path, ".stl", bytes(84))
    corners = np.zeros((1, 3, 3))
    corners[0, 0, 0] = np.nan
    assert "not finite" in refused(marker, tmp_path, ".stl", stl(corners))
    assert "another kind" in refused(marker, tmp_path, ".stl", b"solid x\nvortex 1 2 3\nendsolid x\n")
    assert "no end" in refused(marker, tmp_path, ".stl", b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 1 2 3\n")
    three = b"vertex 1 2 3\nvertex 4 5 x\nvertex 7 8 9\n"
    assert "numbers" in refused(marker, tmp_path, ".stl", b"solid\nouter loop\n" + three + b"endfacet\nendsolid\n")


def test_3mf_that_lie(marker, data, tmp_path):
    good = data[".3mf"]
    text = model(good)

    def said(changed):
        assert changed != text
        return refused(marker, tmp_path, ".3mf", with_model(good, changed))

    assert "package" in refused(marker, tmp_path, ".3mf", good[: good.rindex(b"PK\5\6") + 10])
    assert "package" in refused(marker, tmp_path, ".3mf", b"PK\3\4 nothing")
    empty = BytesIO()
    with zipfile.ZipFile(empty, "w") as package:
        package.writestr("a.txt", "")
    assert "without a model" in refused(marker, tmp_path, ".3mf", empty.getvalue())
    assert "complete XML" in said(text[:-20])
    assert "a document type" in said(text.replace("<model", '<!DOCTYPE x [<!ENTITY a "b">]><model', 1))
    assert "a unit of length" in said(text.replace('unit="millimeter"', 'unit="furlong"'))
    assert "numbers" in said(text.replace('v1="', 'v1="x', 1))
    assert "is missing" in said(text.replace('v1="', 'v1="99999', 1))
    assert "found object '99" in said(text.replace('<item objectid="', '<item objectid="99'))
    # An object of itself.
    circle = '<components><component objectid="2"/></components></object>'
    assert "objects that exist" in said(re.sub("<mesh>.*</mesh></object>", circle, text, flags=re.DOTALL))


def test_3mf_whose_parts_are_others_in_prusaslicer(marker, data, tmp_path):
    with zipfile.ZipFile(BytesIO(data[".3mf"])) as package:
        text = package.read(VOLUMES).decode()

    def said(changed):
        assert changed != text
        (tmp_path / "a.3mf").write_bytes(with_model(data[".3mf"], changed, VOLUMES))
        return [finding.sentence for finding in verify(marker, tmp_path / "a.3mf").findings]

    assert sentence("no inlay", 3) in said(re.sub(r"<volume.*\n(?=</object>)", "", text))
    same = "light and dark parts are printed by the same extruder"
    assert same in said(text.replace('"extruder" value="2"', '"extruder" value="1"', 1))
    bad = with_model(data[".3mf"], text.replace("firstid", "first"), VOLUMES)
    assert "numbers" in refused(marker, tmp_path, ".3mf", bad)


def test_3mf_of_parts_and_of_other_programs_is_read(marker, data, tmp_path):
    (tmp_path / "bare.3mf").write_bytes(with_model(data[".3mf"], "", VOLUMES))
    (tmp_path / "parts.3mf").write_bytes(data["-parts.3mf"])
    for name in ("bare.3mf", "parts.3mf"):
        assert verify(marker, tmp_path / name).passed


def test_glb_that_lie(marker, data, tmp_path):
    good = data[".glb"]

    def said(change):
        document, rest = gltf(good)
        change(document)
        return refused(marker, tmp_path, ".glb", glb(document, rest))

    assert "a GLB of glTF 2.0" in refused(marker, tmp_path, ".glb", b"glTX" + good[4:])
    assert "a complete GLB" in refused(marker, tmp_path, ".glb", good[:-8])
    assert "a cycle" in said(lambda g: g["nodes"][0].update(children=[0]))
    assert "extensions" in said(lambda g: g.update(extensionsRequired=["KHR_draco_mesh_compression"]))
    assert "inconsistent parts" in said(lambda g: g["accessors"][0].update(count=10**9))
    assert "inconsistent parts" in said(lambda g: g["accessors"][0].update(bufferView=-1))
    assert "inconsistent parts" in said(lambda g: g["bufferViews"][0].update(byteOffset=-4))
    assert "inconsistent parts" in said(lambda g: g["meshes"][0]["primitives"][0].pop("attributes"))
    assert "inconsistent parts" in said(lambda g: g.pop("scenes"))
    assert "in another file" in said(lambda g: g["buffers"][0].update(uri="a.bin"))
    assert "found none" in said(lambda g: [mesh["primitives"][0].update(mode=1) for mesh in g["meshes"]])
    assert "inconsistent parts" in said(lambda g: [n.update(matrix=["x"] * 16) for n in g["nodes"]])


def test_3mf_and_glb_that_grow(marker, data, tmp_path):
    text = model(data[".3mf"])
    head, tail = text[: text.index("<resources>") + 11], "</resources><build>{}</build></model>"
    mesh = (
        '<object id="0"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="9" y="0" z="0"/>'
        '<vertex x="0" y="9" z="1"/></vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh></object>'
    )
    ten = "".join(
        f'<object id="{k + 1}"><components>{f"<component objectid={chr(34)}{k}{chr(34)}/>" * 10}</components></object>'
        for k in range(9)
    )

    def said(resources, build=""):
        return refused(marker, tmp_path, ".3mf", with_model(data[".3mf"], head + resources + tail.format(build)))

    start = time.process_time()
    assert "20000 parts of objects" in said(mesh + ten, '<item objectid="9"/>')
    assert "at most 20000 items" in said(mesh, '<item objectid="0"/>' * 20_001)
    bases = '<base name="a" displaycolor="#FFFFFF"/>' * 20_001
    assert "at most 20000 materials" in said(f'<basematerials id="1">{bases}</basematerials>')
    assert "without an end" in said(f'<object id="1" name="{"x" * 1_000_000}"/>')
    many = BytesIO()
    with zipfile.ZipFile(many, "w") as package:
        for k in range(1001):
            package.writestr(str(k), "")
    assert "at most 1000 files" in refused(marker, tmp_path, ".3mf", many.getvalue())

    document, rest = gltf(data[".glb"])
    drawn = next(k for k, node in enumerate(document["nodes"]) if "mesh" in node)
    document["scenes"][0]["nodes"] = [drawn] * 19_999
    assert "triangles" in refused(marker, tmp_path, ".glb", glb(document, rest))
    document["extras"] = [[]] * 3_000_000
    assert "10 MB of text" in refused(marker, tmp_path, ".glb", glb(document, rest))
    assert time.process_time() - start < 10


def test_steps_that_lie_and_what_comes_after_them(marker, data, tmp_path):
    good = data[".step"]
    assert "or no end" in refused(marker, tmp_path, ".step", good[: len(good) // 2])
    assert "or no end" in refused(marker, tmp_path, ".step", b"\x89PNG" + good)
    assert "10 000 km" in refused(marker, tmp_path, ".step", good.replace(b"42.8", b"1e39"))
    nothing = good.partition(b"DATA;\n")[0] + b"DATA;\nENDSEC;\nEND-ISO-10303-21;\n"
    assert "STEP" in refused(marker, tmp_path, ".step", nothing)
    assert "something else" in refused(marker, tmp_path, ".brep", good)
    (tmp_path / "a.step").write_bytes(good)
    assert verify(marker, tmp_path / "a.step").passed


def test_a_cylinder_of_another_radius_than_its_edges_is_named(marker, data, tmp_path):
    (tmp_path / "a.step").write_bytes(
        re.sub(rb"(CYLINDRICAL_SURFACE\('',#\d+,)6\.\)", rb"\g<1>5.98)", data[".step"], count=1)
    )
    check = verify(marker, tmp_path / "a.step")
    assert not check.passed
    assert "up to 0.02 mm off its faces" in str(check.findings[0])


@pytest.fixture
def other_parser(monkeypatch, tmp_path):
    """Another script in place of the one that parses."""

    def use(name, code):
        (tmp_path / f"{name}.py").write_text(code)
        monkeypatch.setattr(solid_files, "PARSER", tmp_path / f"{name}.py")

    yield use
    guard.end_children()


def test_a_kernel_that_crashes_or_never_ends(marker, data, tmp_path, other_parser, monkeypatch):
    other_parser("crashes", "import os\n\ndef step(data):\n    os._exit(1)\n")
    assert "breaks it" in refused(marker, tmp_path, ".step", data[".step"])
    monkeypatch.setitem(guard.KINDS, "CAD", replace(guard.KINDS["CAD"], seconds=0.1))
    other_parser("sleeps", "import time\n\ndef step(data):\n    time.sleep(100)\n")
    start = time.perf_counter()
    assert "takes more than" in refused(marker, tmp_path, ".step", data[".step"])
    assert time.perf_counter() - start < 20


def test_a_kernel_that_is_not_there(marker, data, tmp_path, other_parser):
    text = "libGL.so.1: cannot open shared object file"
    other_parser("lacks", f"def prepare():\n    raise ImportError({text!r})\n")
    (tmp_path / "a.step").write_bytes(data[".step"])
    (tmp_path / "a.stl").write_bytes(data[".stl"])
    with pytest.raises(MissingLibraryError, match=r"libGL\.so\.1.*pip install \./detector '\.\[step\]'"):
        verify(marker, tmp_path / "a.step")
    # Other files are verified all the same.
    step, mesh = verify_all(lambda path: verify(marker, path), [tmp_path / "a.step", tmp_path / "a.stl"])
    assert "libGL" in step.error
    assert mesh.passed


def test_the_parser_says_what_is_missing():
    code = "import sys; sys.modules['OCP'] = None; from markergen.guard import run_parser; run_parser(*sys.argv[1:])"
    run = subprocess.run(
        [sys.executable, "-c", code, solid_files.PARSER, str(8 << 30)], input=b"", capture_output=True, check=True
    )
    # Without arrays.
    assert struct.unpack(">Q", run.stdout[:8])[0] == len(run.stdout) - 16
    assert "OCP" in json.loads(run.stdout[8:-8])["missing"]


def test_a_ring_in_front_of_a_dot_on_the_far_face_stays_a_ring():
    """0.45 mm beside the far dot's middle, the outer circle of the ring is around that, the inner one is not."""
    far = [0.45, 0, -80]
    rims = Rims(
        np.array([far, [0, 0, 0], [0, 0, 0], [0, 0, -0.6]]), np.array([[0, 0, -1.0], [0, 0, 1], [0, 0, 1], [0, 0, -1]]),
        np.array([4.5, 4.5, 2.24, 4.5]), np.zeros(4), np.array([0, 1, 1, 1]), np.full(4, 9.0),
    )  # fmt: skip
    dots = dots_of(rims, np.array([4.5]))
    assert dots.inner.tolist() == [2.24]
    assert dots.centers.tolist() == [[0, 0]]


def test_rims_of_boxes_and_cylinders_that_touch():
    from trimesh.creation import annulus, box, cylinder

    disk = cylinder(2.0, 1.0, sections=100).apply_translation((0, 0, 0.5))
    ring = annulus(2.0, 3.0, 1.0, sections=100).apply_translation((0, 0, 0.5))
    corners = np.concatenate([np.asarray(part.triangles, float) for part in (box((9, 9, 1)), disk, ring)])
    rims = rims_of(np.round(corners, 6))
    assert set(np.round(rims.radii, 3)) == {2.0, 3.0}
    np.testing.assert_allclose(np.linalg.norm(rims.centers[:, :2], axis=1), 0, atol=1e-6)
    assert set(np.round(rims.centers[:, 2], 3)) == {0.0, 1.0}
    assert not open_edges(corners)
    assert open_edges(corners[1:])
