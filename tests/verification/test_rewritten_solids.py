"""Solids that other programs read and wrote again pass; so do the files of light and dark parts alone."""

from dataclasses import replace

import numpy as np
import pytest
import rewritten_solids as rewritten
from spoiled_solids import stl_of_text, triangles

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.verification.reading import Settings
from markergen.verification.wanted_solids import ALONE

HOLES = (Hole(-0.022, -0.008, 0.0034, name="M3"), Hole(0.016, -0.024, 0.0034, 0.0065, name="M3"))
PROCESSES = {
    "inlaid": Fabrication(engrave=False, tolerance=5e-5),
    "with a gap": Fabrication(gap=1e-4, engrave=False, tolerance=5e-5),
    "half-balls": Fabrication("dome", engrave=False, tolerance=5e-5),
    "through": Fabrication("cnc", through=True, engrave=False, tolerance=5e-5),
}


@pytest.fixture(scope="module")
def marker(make_marker):
    points = np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012], [0.0, 0.035]])
    plate = Substrate(thickness=0.004, holes=HOLES)
    return replace(make_marker(points, 0.05, 0.012), substrate=plate, tag=Tag("aruco:DICT_4X4_50", 7, 0.02))


@pytest.fixture(scope="module")
def files(marker, tmp_path_factory):
    """Folder with the files of a process, written once."""
    folders = {}

    def get(name, *suffixes):
        folder = folders.setdefault(name, tmp_path_factory.mktemp("solids"))
        new = [folder / f"a{suffix}" for suffix in suffixes if not (folder / f"a{suffix}").exists()]
        if new:
            save(marker, new, ExportOptions(fabrication=PROCESSES[name]))
        return folder

    return get


def by_trimesh(suffix):
    def rewrite(folder, out):
        import trimesh

        scene = trimesh.load_scene(folder / "a.glb")
        if suffix == ".stl":
            # In the frame of the GLB, y up and in meters, turned and scaled as its user would.
            scene.apply_transform(
                1e3 * np.diag([1, 1, 1, 1e-3]) @ [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]
            )
        scene.export(out)

    return rewrite


def by_lib3mf(folder, out):
    import lib3mf

    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    model.QueryReader("3mf").ReadFromFile(str(folder / "a.3mf"))
    model.QueryWriter("3mf").WriteToFile(str(out))


def by_gmsh(folder, out):
    with rewritten.in_gmsh(folder / "a.step") as gmsh:
        gmsh.write(str(out))


def as_text(folder, out):
    out.write_bytes(stl_of_text(triangles((folder / "a.stl").read_bytes())))


def merged(folder, out):
    """One STL in which what touches has the same corners, in any order, rounded as text."""
    corners = np.concatenate([np.round(part.corners, 4) for part in rewritten.pieces(folder / "a.glb")])
    rewritten.write(out, [rewritten.Piece("", False, np.random.default_rng(0).permutation(corners))])


REWRITINGS = {
    "trimesh .glb": (by_trimesh(".glb"), ".glb"),
    "trimesh .stl": (by_trimesh(".stl"), ".stl"),
    "lib3mf .3mf": (by_lib3mf, ".3mf"),
    "gmsh .step": (by_gmsh, ".step"),
    "gmsh .brep": (by_gmsh, ".brep"),
    "text .stl": (as_text, ".stl"),
    "merged .stl": (merged, ".stl"),
}
SOURCE = {"trimesh": ".glb", "merged": ".glb", "lib3mf": ".3mf", "gmsh": ".step", "text": ".stl"}
CASES = [(name, made) for name in REWRITINGS for made in PROCESSES]
QUICK = [(name, made) for name in REWRITINGS for made in ["inlaid"]]
TABLE = [case if case in QUICK else pytest.param(*case, marks=pytest.mark.long) for case in CASES]


@pytest.mark.parametrize(("name", "made"), TABLE)
def test_what_was_rewritten_passes(marker, files, tmp_path, name, made):
    rewrite, suffix = REWRITINGS[name]
    rewrite(files(made, SOURCE[name.split()[0]]), tmp_path / f"b{suffix}")
    check = verify(marker, tmp_path / f"b{suffix}", Settings(fabrication=PROCESSES[made]))
    assert check.passed, check.findings
    assert check.dots == 5
    assert check.largest < 1e-6


@pytest.mark.parametrize(
    "made",
    [name if name in ("inlaid", "with a gap") else pytest.param(name, marks=pytest.mark.long) for name in PROCESSES],
)
def test_light_and_dark_parts_alone_pass_and_are_told(marker, files, made):
    folder = files(made, ".stl")
    dark, light = (verify(marker, folder / f"a-{material}.stl") for material in ("dark", "light"))
    assert dark.passed, dark.findings
    assert dark.notes == (ALONE["dark"],)
    assert light.passed, light.findings
    assert light.notes[0].startswith(ALONE["light"])
