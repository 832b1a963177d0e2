"""Solids of every process in every format: what is right passes, and what is wrong is called by its name."""

import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from sentences import pattern, sentence
from spoiled_solids import SOLIDS, glb, gltf, model, resized, stl, stl_of_text, triangles, with_model

from markergen.exporters import ExportOptions
from markergen.exporters.saving import save
from markergen.model.fabrication import Fabrication
from markergen.model.feature import Feature
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.verification import verify
from markergen.verification.reading import PRINTABLE, Settings
from markergen.verification.result import Finding
from markergen.verification.solids import SHEET

FABRICATIONS = {
    "fdm": Fabrication(),
    "fdm with a gap": Fabrication(gap=1e-4),
    "slip": Fabrication("cnc"),
    "through": Fabrication("cnc", through=True),
    "laser": Fabrication("laser"),
    "half-balls": Fabrication("dome"),
    "balls": Fabrication("dome", dome="ball"),
}
# What is promised: 20 um of a STEP, 5 um of a mesh; what is found is rounding, half a grain of a grid of 15 nm.
LIMIT = {".step": 1e-9, ".brep": 1e-9, ".stl": 2e-8, ".3mf": 2e-8, ".glb": 2e-8}


def plain(fabrication, tolerance=5e-5):
    """Without engraving and fillets, and with few triangles: small files."""
    return ExportOptions(fabrication=replace(fabrication, engrave=False, foot=0.0, tolerance=tolerance))


def raised(marker, heights=(0.0, 0.006, 0.012)):
    points = tuple(replace(p, z=heights[k % len(heights)]) for k, p in enumerate(marker.control_points))
    return replace(marker, control_points=points)


@pytest.fixture(scope="module")
def skew(make_marker):
    """No motion but one brings its dots onto each other."""
    points = np.array([[0.03, 0.02], [-0.035, 0.018], [-0.01, -0.03], [0.036, -0.012], [0.0, 0.035]])
    return make_marker(points, 0.05, 0.012)


@pytest.fixture(scope="module")
def variants(skew):
    """Marker by what it has and how it is made."""
    holes = (Hole(-0.022, -0.008, 0.0034, name="M3"), Hole(0.016, -0.024, 0.0034, 0.0065, name="M3"))
    full = replace(raised(skew), substrate=Substrate(thickness=0.004, holes=holes))

    def get(name, made):
        # Balls stand before a plate below the plane of a tag.
        tag = None if made == "balls" else Tag("aruco:DICT_4X4_50", 7, 0.02)
        return skew if name == "plain" else replace(full, tag=tag)

    return get


@pytest.fixture(scope="module")
def files(variants, tmp_path_factory):
    """Path of the file of a variant, by its name, that of the fabrication, and suffix; written once."""
    folder = tmp_path_factory.mktemp("solids")

    def get(name, made, suffix):
        path = folder / f"{name}-{made}{suffix}".replace(" ", "-")
        if not path.exists():
            save(variants(name, made), [path], plain(FABRICATIONS[made]))
        return path

    return get


def rounded(check):
    """Sentences with their numbers to two decimals: the grid of meshes is 15 nm and finer."""
    return [re.sub(r"\d+\.\d+", lambda number: f"{float(number[0]):.2f}", text) for text in sentences(check)]


def kinds(check):
    return [finding.kind for finding in check.findings]


def sentences(check):
    return [finding.sentence for finding in check.findings]


def either(quick, slow):
    """Cases of which some are left to `make test-long`."""
    return [*quick, *(pytest.param(*case, marks=pytest.mark.long) for case in slow)]


EVERY = list(product(["plain", "full"], FABRICATIONS, [*SOLIDS, ".brep"]))
QUICK = [
    case for case in EVERY
    if case[:2] == ("full", "fdm")
    or case == ("plain", "laser", ".glb")
    or (case[0] == "full" and case[2] == (".step", ".stl")[list(FABRICATIONS).index(case[1]) % 2])
]  # fmt: skip
"""Every format, and every process in a format that is exact or in a mesh, in turn."""

EXACT_AND_MESH = pytest.mark.parametrize("suffix", either([".step", ".stl"], [[".3mf"], [".glb"]]))
EXACT = pytest.mark.parametrize("suffix", either([".step"], [[".stl"], [".3mf"], [".glb"]]))
MESH = pytest.mark.parametrize("suffix", either([".stl"], [[".step"], [".3mf"], [".glb"]]))
"""What is found in triangles, whichever file they are read from."""


def in_turn(first, second):
    """All pairs of two lists, of which the core has each item of the longer one once, beside one of the other."""
    few = {(first[k % len(first)], second[k % len(second)]) for k in range(max(len(first), len(second)))}
    return [pytest.param(*pair, marks=() if pair in few else pytest.mark.long) for pair in product(first, second)]


@pytest.mark.parametrize(("name", "made", "suffix"), either(QUICK, [case for case in EVERY if case not in QUICK]))
def test_what_was_exported_is_right(variants, files, name, made, suffix):
    check = verify(variants(name, made), files(name, made, suffix))
    assert check.passed, check.findings
    assert (check.dots, check.copies) == (5, 1)
    assert check.largest < LIMIT[suffix]
    assert check.tolerance == PRINTABLE
    np.testing.assert_allclose(check.scale, 1, atol=1e-6)
    assert not check.notes


def edited(marker, index=3, **changes):
    points = list(marker.control_points)
    points[index] = replace(points[index], **changes)
    return replace(marker, control_points=tuple(points))


def check_of(marker, drawn, path, fabrication):
    """Check of a marker against a file that another one is made as."""
    save(drawn, [path], plain(fabrication))
    return verify(marker, path)


@EXACT_AND_MESH
@pytest.mark.parametrize("made", either(["slip"], [["laser"], ["half-balls"]]))
def test_dots_of_another_place_height_or_size_are_named(skew, tmp_path, made, suffix):
    marker = raised(skew)
    drawn = edited(marker, x=marker.control_points[3].x + 2e-4)
    drawn = edited(edited(drawn, index=1, z=5.9e-3), index=4, feature=Feature(0.0121))
    check = check_of(marker, drawn, tmp_path / f"wrong{suffix}", FABRICATIONS[made])
    shifted, diameter, height = rounded(check)
    assert re.match(pattern("dot off", 3, "0.20? mm") + r" \(x \+(200|199.99|200.0\d) um, y", shifted)
    assert re.match("dot 4 " + pattern("diameter", "12.10? mm", "12 mm"), diameter)
    assert re.match(pattern("dot too low", 1, "0.10? mm"), height)
    assert check.worst == 3


@EXACT_AND_MESH
@pytest.mark.parametrize("made", either(["laser"], [["fdm"], ["half-balls"]]))
def test_dots_of_another_kind_are_named(skew, tmp_path, made, suffix):
    drawn = edited(edited(skew, index=0, feature=Feature(0.012)), feature=Feature(0.012, 0.006))
    check = check_of(skew, drawn, tmp_path / f"wrong{suffix}", FABRICATIONS[made])
    assert sentences(check) == [sentence("dot for ring", 0), sentence("ring for dot", 3)]


@MESH
@pytest.mark.parametrize("made", either(["laser"], [["fdm"]]))
def test_dots_too_few_or_too_many_and_other_markers_are_named(skew, make_ngon, tmp_path, made, suffix):
    points = skew.control_points
    fewer = replace(skew, control_points=(*points[:2], *points[3:]))
    more = replace(skew, control_points=(*points, replace(points[1], id=9, x=0.0, y=0.0)))
    for drawn, kind in [
        (fewer, "missing"), (more, "extra"), (make_ngon(7, 0.05, 0.012), "another marker"),
        (make_ngon(5, 0.05, 0.005), "no dots"),
    ]:  # fmt: skip
        check = check_of(skew, drawn, tmp_path / f"wrong{suffix}", FABRICATIONS[made])
        assert kinds(check) == [kind], check


@MESH
def test_a_marker_without_its_relief_and_the_other_way_around(skew, tmp_path, suffix):
    path = tmp_path / f"wrong{suffix}"
    assert sentences(check_of(raised(skew), skew, path, Fabrication())) == [
        sentence("dot too low", dot, depth) for dot, depth in [(1, "6 mm"), (2, "12 mm"), (4, "6 mm")]
    ]
    assert kinds(check_of(skew, raised(skew), path, Fabrication())) == ["height"] * 3


@pytest.mark.parametrize(
    ("made", "suffix"), [*in_turn(["fdm", "laser"], SOLIDS), *either([], product(["balls"], SOLIDS))]
)
def test_a_scale_is_named(variants, files, tmp_path, made, suffix):
    path = tmp_path / f"scaled{suffix}"
    path.write_bytes(resized(files("full", made, suffix).read_bytes(), suffix, 0.998))
    check = verify(variants("full", made), path)
    assert sentences(check) == [sentence("scaled", "0.998 along x and y")]
    np.testing.assert_allclose(check.scale, 0.998, atol=1e-6)
    if suffix == ".step":
        return
    path.write_bytes(resized(files("plain", "fdm", suffix).read_bytes(), suffix, 1.0, 0.998, 1.0))
    # Circles that are stretched are no circles: their diameters are off by half as much.
    assert sentences(verify(variants("plain", "fdm"), path))[0] == sentence("scaled", "0.998 along y")


UNITS = {
    1e-3: sentence("unit", "0.001", "m", "mm"),
    1 / 25.4: sentence("unit", "0.0393701", "inch", "mm"),
    1e3: sentence("unit", "1000", "mm", "m"),
}


@pytest.mark.parametrize(("factor", "suffix"), in_turn(list(UNITS), SOLIDS))
@pytest.mark.parametrize("name", either(["full"], [["plain"]]))
def test_a_wrong_unit_is_named(variants, files, tmp_path, name, suffix, factor):
    path = tmp_path / f"unit{suffix}"
    path.write_bytes(resized(files(name, "fdm", suffix).read_bytes(), suffix, factor))
    check = verify(variants(name, "fdm"), path, Settings(fabrication=plain(FABRICATIONS["fdm"]).fabrication))
    assert sentences(check) == [UNITS[factor]]
    np.testing.assert_allclose(check.scale, factor, rtol=1e-4)
    assert np.isnan(check.largest)


@pytest.mark.parametrize("name", ["plain", "full"])
def test_inches_are_not_a_thick_plate(variants, files, tmp_path, name):
    path = tmp_path / "inches.3mf"
    path.write_bytes(resized(files(name, "fdm", ".3mf").read_bytes(), ".3mf", 25.4))
    assert sentences(verify(variants(name, "fdm"), path)) == [sentence("unit", "25.4", "mm", "inch")]


@pytest.mark.parametrize(("made", "suffix"), in_turn(["fdm", "laser"], [".stl", ".3mf", ".glb"]))
def test_a_mirrored_mesh_is_named(variants, files, tmp_path, made, suffix):
    path = tmp_path / f"mirrored{suffix}"
    data = files("plain", made, suffix).read_bytes()
    if suffix == ".stl":
        path.write_bytes(stl(triangles(data)[:, ::-1] * [-1, 1, 1]))
    else:
        path.write_bytes(resized(data, suffix, -1.0, 1.0, 1.0))
    [finding] = verify(variants("plain", "fdm"), path).findings
    assert finding == Finding("mirrored", "mirrored", "export it again, and save it without mirroring it")


@pytest.mark.parametrize(("name", "suffix"), in_turn(["full", "plain"], [".stl", ".3mf", ".glb"]))
def test_a_mesh_that_is_mirrored_through_its_plane_is_named(variants, files, tmp_path, name, suffix):
    path = tmp_path / f"mirrored{suffix}"
    data = files(name, "fdm", suffix).read_bytes()
    if suffix == ".stl":
        path.write_bytes(stl(triangles(data)[:, ::-1] * [1, 1, -1]))
    else:
        path.write_bytes(resized(data, suffix, 1.0, 1.0, -1.0))
    [finding] = verify(
        variants(name, "fdm"), path, Settings(fabrication=plain(FABRICATIONS["fdm"]).fabrication)
    ).findings
    sentence = "mirrored through its plane: all heights have the opposite sign"
    assert finding == Finding("mirrored", sentence, "export it again, and save it without mirroring it")


@EXACT_AND_MESH
def test_a_small_solid_was_not_fitted_to_paper(variants, files, tmp_path, suffix):
    path = tmp_path / f"small{suffix}"
    path.write_bytes(resized(files("plain", "fdm", suffix).read_bytes(), suffix, 0.97))
    [finding] = verify(variants("plain", "fdm"), path).findings
    assert finding.sentence == "scaled by 0.97 along x and y"
    assert finding.remedy == "export it again, and save it without scaling it"


@EXACT
def test_holes_are_looked_at(variants, files, tmp_path, suffix):
    marker = variants("full", "fdm")
    first, second = marker.substrate.holes

    def found(*holes):
        wanted = replace(marker, substrate=replace(marker.substrate, holes=holes))
        return rounded(verify(wanted, files("full", "fdm", suffix)))

    assert not found(first, second)
    assert found(first) == [sentence("hole extra", "x 16, y -24 mm")]
    bare = replace(marker, substrate=replace(marker.substrate, holes=()))
    remedies = {finding.remedy for finding in verify(bare, files("full", "fdm", suffix)).findings}
    assert remedies == {"remove it, or give the options that export was given"}
    (moved,) = found(replace(first, x=-0.0221), second)
    assert re.fullmatch(pattern("hole off", "M3", "x -22.10, y -8 mm", "0.10? mm"), moved)
    (wider,) = found(replace(first, diameter=0.0035), second)
    assert re.fullmatch("the hole M3 .* " + pattern("diameter", "3.40 mm", "3.50 mm"), wider)
    (wider,) = found(first, replace(second, sink=0.0066))
    assert re.search(pattern("diameter", "6.50 mm", "6.60 mm"), wider)
    assert found(first, replace(second, x=0.0)) == [
        sentence("hole missing", "M3", "x 0, y -24 mm"), sentence("hole extra", "x 16, y -24 mm"),
    ]  # fmt: skip


@EXACT_AND_MESH
def test_a_hole_as_large_as_a_dot_is_no_dot(skew, tmp_path, suffix):
    marker = replace(skew, substrate=Substrate(holes=(Hole(0.0, 0.0, 0.012, name="post"),)))
    check = check_of(marker, marker, tmp_path / f"post{suffix}", Fabrication("laser"))
    assert check.passed, check.findings


@pytest.mark.parametrize(("made", "suffix"), in_turn(["fdm with a gap", "laser"], [".stl", ".step"]))
def test_the_tag_is_looked_at(variants, files, made, suffix):
    marker, path = variants("full", made), files("full", made, suffix)
    other = replace(marker, tag=replace(marker.tag, id=8))
    assert sentences(verify(other, path)) == [sentence("tag missing", "aruco:DICT_4X4_50:8")]
    moved = verify(replace(marker, tag=replace(marker.tag, center=(1e-4, 0.0))), path)
    assert kinds(moved) == ["tag"] * 4
    # Where solids would touch, an STL has 0.1 um between them.
    assert [float(text.split()[-3]) for text in sentences(moved)] == pytest.approx([100.0] * 4, abs=0.2)
    larger = verify(replace(marker, tag=replace(marker.tag, side=0.0201)), path)
    assert set(kinds(larger)) == {"tag"}


@pytest.mark.parametrize(("made", "suffix"), in_turn(["slip", "laser"], SOLIDS))
def test_a_tag_that_is_not_there(variants, files, made, suffix):
    marker = replace(variants("plain", made), tag=variants("full", made).tag)
    check = verify(marker, files("plain", made, suffix))
    assert sentences(check) == [sentence("tag missing", "aruco:DICT_4X4_50:7")]


@EXACT_AND_MESH
def test_plates_for_sheets_have_no_dots(variants, make_in, shapes, tmp_path, suffix):
    marker = variants("plain", "fdm")
    full = replace(variants("full", "fdm"), control_points=marker.control_points)
    path = tmp_path / f"plate{suffix}"
    for drawn in (marker, full):
        check = check_of(drawn, drawn, path, Fabrication("print"))
        assert check.passed, check.findings
        assert check.dots == check.copies == 0
        assert check.notes == (SHEET,)
    other = replace(marker, boundary=make_in(shapes["L"], 5, 0.012).boundary)
    assert kinds(verify(other, path)) == ["no dots"]


@MESH
def test_recesses_for_printed_dots_are_no_dots(variants, tmp_path, suffix):
    marker, path = variants("full", "fdm"), tmp_path / f"recesses{suffix}"
    check = check_of(marker, marker, path, Fabrication("print"))
    assert check.passed, check.findings
    assert check.notes == (sentence("recesses", "50 um"),)
    moved = edited(marker, x=marker.control_points[3].x + 1e-4)
    assert kinds(verify(moved, path)) == ["shifted"]


@pytest.mark.parametrize("name", ["L", "two squares"])
def test_plates_for_sheets_of_other_outlines(make_in, shapes, on_wider_plate, tmp_path, name):
    marker = on_wider_plate(make_in(shapes[name], 5, 0.012))
    save(marker, [tmp_path / "a.step"], plain(Fabrication("print")))
    check = verify(marker, tmp_path / "a.step")
    assert check.passed, check.findings
    assert "no dots" in check.notes[0]


@pytest.mark.parametrize("made", either(["fdm"], [["laser"]]))
def test_colors_are_looked_at_in_a_step(variants, files, tmp_path, made):
    text = files("plain", made, ".step").read_text()
    white = re.sub(r"(COLOUR_RGB\('',)[^;]*;", r"\g<1>1.,1.,1.);", text)
    assert white != text
    (tmp_path / "a.step").write_text(white)
    check = verify(variants("plain", made), tmp_path / "a.step")
    assert sentences(check) == [sentence("same color")]


@pytest.mark.parametrize("made", either(["fdm"], [["laser"]]))
def test_colors_are_looked_at_in_meshes(variants, files, tmp_path, made):
    marker = variants("plain", "fdm")
    document, rest = gltf(files("plain", made, ".glb").read_bytes())
    for material in document["materials"]:
        material["pbrMetallicRoughness"]["baseColorFactor"] = [1, 1, 1, 1]
    (tmp_path / "a.glb").write_bytes(glb(document, rest))
    assert set(kinds(verify(marker, tmp_path / "a.glb"))) == {"color"}
    data = files("plain", made, ".3mf").read_bytes()
    text = model(data)
    first = text.index("displaycolor=") + 14
    second = text.index("displaycolor=", first) + 14
    swapped = text[:second] + text[first : first + 9] + text[second + 9 :]
    (tmp_path / "a.3mf").write_bytes(with_model(data, swapped))
    assert set(kinds(verify(marker, tmp_path / "a.3mf"))) == {"color"}


def test_what_does_not_close_is_named(variants, tmp_path):
    save(variants("plain", "fdm"), [tmp_path / "a.stl"], plain(Fabrication(), 1e-5))
    corners = triangles((tmp_path / "a.stl").read_bytes())
    # Of the plate's lower face: no dot is touched.
    low = np.flatnonzero(corners[:, :, 2].max(axis=1) < -2.9)
    (tmp_path / "a.stl").write_bytes(stl(np.delete(corners, low[3], axis=0)))
    check = verify(variants("plain", "fdm"), tmp_path / "a.stl")
    assert kinds(check) == ["solid"]
    assert check.findings[0].sentence.endswith(sentence("open edges"))


@pytest.mark.parametrize(("name", "made"), either([("plain", "fdm")], [("full", "slip")]))
def test_an_inlay_that_is_not_flush_is_named(variants, files, tmp_path, name, made):
    document, rest = gltf(files(name, made, ".glb").read_bytes())
    (node,) = [node for node in document["nodes"] if node.get("name") == "dot-3"]
    for z, expected in ((2e-4, "0.2 mm too high"), (-2e-4, "0.2 mm too low")):
        node["translation"] = [0, 0, z]
        (tmp_path / "a.glb").write_bytes(glb(document, rest))
        assert sentences(verify(variants(name, made), tmp_path / "a.glb")) == [f"dot 3 is {expected}"]
    node["translation"] = [1e-4, 0, 0]
    (tmp_path / "a.glb").write_bytes(glb(document, rest))
    assert (
        sentence("dot off", 3, "0.1 mm") + " (x +100 um, y"
        in sentences(verify(variants(name, made), tmp_path / "a.glb"))[0]
    )


@pytest.mark.parametrize("suffix", either([".stl", ".glb"], [[".step"], [".3mf"]]))
def test_a_file_that_was_moved_up_is_told_once(variants, files, tmp_path, suffix):
    path = tmp_path / f"up{suffix}"
    data = files("full", "fdm", suffix).read_bytes()
    if suffix == ".stl":
        path.write_bytes(stl(triangles(data) + [5, -7, 3]))
    elif suffix == ".3mf":
        # Where an item is on the bed does not matter.
        def lifted(parts):
            return f'<vertex x="{float(parts[1]) + 5}" y="{float(parts[2]) - 7}" z="{float(parts[3]) + 3}"/>'

        path.write_bytes(with_model(data, re.sub(r'<vertex x="(.*?)" y="(.*?)" z="(.*?)"/>', lifted, model(data))))
    elif suffix == ".glb":
        document, rest = gltf(data)
        for child in document["nodes"][0]["children"]:
            document["nodes"][child]["translation"] = [5e-3, -7e-3, 3e-3]
        path.write_bytes(glb(document, rest))
    else:
        path.write_bytes(assembled(data, tmp_path, (5, -7, 3), 30))
    assert sentences(verify(variants("full", "fdm"), path)) == [sentence("dot too high", "all dots are", "3 mm")]


def assembled(data, folder, translation, degrees, move=None):
    """STEP of an assembly of the parts of another one, each moved by the assembly."""
    import cadquery

    (folder / "in.step").write_bytes(data)
    solids = cadquery.importers.importStep(str(folder / "in.step")).solids().vals()
    assembly = cadquery.Assembly(name="moved")
    for number, solid in enumerate(solids):
        by = move if move and number == 3 else (0, 0, 0)
        # Plate and core of the ring are light. Away from where it is made, and back.
        back = cadquery.Location(cadquery.Vector(40, 30, 20))
        place = cadquery.Location(cadquery.Vector(*translation), cadquery.Vector(0, 0, 1), degrees)
        offset = cadquery.Location(cadquery.Vector(*by))
        color = cadquery.Color(1, 1, 1) if number in (0, 2) else cadquery.Color(0.05, 0.05, 0.05)
        assembly.add(solid.moved(back), loc=place * offset * back.inverse, name=f"part {number}", color=color)
    assembly.export(str(folder / "out.step"))
    return (folder / "out.step").read_bytes()


def test_assemblies_that_move_parts_are_followed(variants, files, tmp_path):
    data = files("plain", "fdm", ".step").read_bytes()
    path = tmp_path / "a.step"
    path.write_bytes(assembled(data, tmp_path, (50, -20, 0), 75))
    check = verify(variants("plain", "fdm"), path)
    assert check.passed, check.findings
    path.write_bytes(assembled(data, tmp_path, (50, -20, 0), 75, move=(0.2, 0, 0)))
    check = verify(variants("plain", "fdm"), path)
    assert "is 0.2 mm off" in check.findings[0].sentence


def test_a_step_in_meters_or_inches_is_as_large(variants, files, tmp_path):
    data = files("full", "fdm", ".step").read_bytes()
    meters = resized(data, ".step", 1e-3).replace(b"SI_UNIT(.MILLI.,.METRE.)", b"SI_UNIT($,.METRE.)")
    (tmp_path / "a.step").write_bytes(meters)
    check = verify(variants("full", "fdm"), tmp_path / "a.step")
    # Digits of a file in meters.
    assert check.largest < 1e-8
    assert check.passed, check.findings


def test_a_text_stl_is_read_as_well(variants, files, tmp_path):
    corners = triangles(files("full", "slip", ".stl").read_bytes())
    (tmp_path / "a.stl").write_bytes(stl_of_text(corners))
    check = verify(variants("full", "fdm"), tmp_path / "a.stl")
    assert check.passed, check.findings


@pytest.mark.parametrize("made", either(["fdm"], [["slip"], ["laser"]]))
@pytest.mark.parametrize("name", ["plain", "full"])
def test_solids_that_share_corners_are_told_apart(variants, tmp_path, name, made):
    # As other programs write an STL: what touches has the same corners, and edges have four triangles.
    parts = []
    from trimesh import load_scene

    # The process is looked for by the volume: circles are to be fine.
    save(variants(name, made), [tmp_path / "a.glb"], plain(FABRICATIONS[made], 1e-5))
    scene = load_scene(tmp_path / "a.glb")
    for node in scene.graph.nodes_geometry:
        transform, geometry = scene.graph[node]
        mesh = scene.geometry[geometry].copy()
        mesh.apply_transform(transform)
        x, y, z = np.moveaxis(1e3 * mesh.triangles, -1, 0)
        parts.append(np.round(np.stack([x, -z, y], axis=-1), 4))
    order = np.random.default_rng(0).permutation(sum(map(len, parts)))
    (tmp_path / "a.stl").write_bytes(stl(np.concatenate(parts)[order]))
    check = verify(variants(name, made), tmp_path / "a.stl")
    # Rounded to a tenth of a micrometer.
    assert check.passed, check.findings
    assert check.largest < 2e-7


def test_balls_are_measured_by_their_surface(variants, files, tmp_path):
    marker = variants("full", "balls")
    corners = triangles(files("full", "balls", ".stl").read_bytes())
    ball = np.linalg.norm(corners - 1e3 * marker.xyz[3], axis=-1).max(axis=1) < 6.001
    corners[ball] += [0.05, 0, 0]
    (tmp_path / "a.stl").write_bytes(stl(corners))
    check = verify(marker, tmp_path / "a.stl")
    assert any(text.startswith(sentence("dot off", 3, "0.05 mm") + " (x +") for text in rounded(check))
