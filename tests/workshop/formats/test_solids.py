import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cad import shown
from rewritten_solids import in_gmsh

from markergen.model.boundary import Circle
from markergen.model.fabrication import Fabrication
from markergen.model.marker import marker_name
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.solid.primitives import COLORS
from markergen.workshop.formats.solids import NamedSolid, normalize, solids_of, write_brep, write_step
from markergen.workshop.processes import parts_of

MICROMETER = 1e-3


@pytest.fixture(scope="module")
def marker(make_ngon):
    """With all that a plate may have, engraved by a laser: most entities, and faces of another color."""
    holes = (Hole(0.05, 0.0, 0.0034, 0.0065), Hole(-0.05, 0.0, 0.003, use="dowel"))
    plain = replace(make_ngon(5, 0.0413, 0.0077), boundary=Circle(0.06), tag=Tag("aruco:DICT_4X4_50", 3, 0.02))
    return replace(plain, substrate=Substrate(thickness=0.004, chamfer=0.0005, holes=holes))


@pytest.fixture(scope="module", params=["fdm", "laser"])
def written(request, marker):
    # Letters take the kernel longer than all else.
    solids = solids_of(parts_of(marker, Fabrication(request.param, engrave=request.param == "laser")).parts)
    return marker, solids, write_step(solids, marker_name(marker))


WITHOUT_LETTERS = pytest.mark.parametrize(
    "written", ["fdm", pytest.param("laser", marks=pytest.mark.long)], indirect=True, scope="module"
)
"""What takes the kernel long is left to `make test-long`."""


@pytest.fixture(scope="module")
def parts(written, tmp_path_factory) -> dict:
    """Name -> (solid, sRGB color, faces with colors of their own) as a reader finds them; ``""`` is the assembly."""
    import cadquery
    from OCP.Quantity import Quantity_Color, Quantity_TOC_sRGB
    from OCP.STEPCAFControl import STEPCAFControl_Reader
    from OCP.TCollection import TCollection_ExtendedString
    from OCP.TDataStd import TDataStd_Name
    from OCP.TDF import TDF_Label, TDF_LabelSequence
    from OCP.TDocStd import TDocStd_Document
    from OCP.XCAFDoc import XCAFDoc_ColorGen, XCAFDoc_ColorSurf, XCAFDoc_DocumentTool

    path: Path = tmp_path_factory.mktemp("step") / "m.step"
    path.write_bytes(written[2])
    document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
    reader = STEPCAFControl_Reader()
    reader.SetColorMode(True)
    reader.SetNameMode(True)
    reader.ReadFile(str(path))
    assert reader.Transfer(document)
    shapes = XCAFDoc_DocumentTool.ShapeTool_s(document.Main())
    colors = XCAFDoc_DocumentTool.ColorTool_s(document.Main())

    def name(label) -> str:
        attribute = TDataStd_Name()
        assert label.FindAttribute(TDataStd_Name.GetID_s(), attribute)
        return attribute.Get().ToExtString()

    roots, members = TDF_LabelSequence(), TDF_LabelSequence()
    shapes.GetFreeShapes(roots)
    assert roots.Length() == 1
    shapes.GetComponents_s(roots.Value(1), members)
    results: dict = {"": name(roots.Value(1))}
    for index in range(1, members.Length() + 1):
        part, color, inner = TDF_Label(), Quantity_Color(), TDF_LabelSequence()
        shape = cadquery.Shape.cast(shapes.GetShape_s(members.Value(index)))
        assert shapes.GetReferredShape_s(members.Value(index), part)
        assert colors.GetColor_s(part, XCAFDoc_ColorSurf, color) or colors.GetColor_s(part, XCAFDoc_ColorGen, color)
        values = tuple(color.Values(Quantity_TOC_sRGB))
        shapes.GetSubShapes_s(part, inner)
        faces = []
        for k in range(1, inner.Length() + 1):
            if colors.GetColor_s(inner.Value(k), XCAFDoc_ColorSurf, color):
                face = cadquery.Shape.cast(shapes.GetShape_s(inner.Value(k)))
                faces.append((face, tuple(color.Values(Quantity_TOC_sRGB))))
        results[name(members.Value(index))] = (shape, values, faces)
    return results


def test_names_and_number_of_solids(written, parts):
    assert parts[""] == "markergen-1a2b3c4d"
    assert list(parts)[1:] == [solid.name for solid in written[1]]
    assert list(parts)[1] == "plate"


def test_colors(written, parts):
    for solid in written[1]:
        _, color, faces = parts[solid.name]
        assert color == pytest.approx(COLORS[solid.material], abs=1e-4)  # 32-bit floats, converted twice
        # What is engraved is dark in the light plate.
        marked = shown(solid).marked
        assert len(faces) == len(marked)
        for face, value in faces:
            assert value == pytest.approx(COLORS["dark"], abs=1e-4)
            assert any(face.Center().toTuple() == pytest.approx(mark.Center().toTuple(), abs=1e-9) for mark in marked)
    assert any(solid.marked for solid in written[1]) == (len(written[1]) == 1)


def test_parts_are_valid_solids_with_the_volumes_that_were_written(written, parts):
    for solid in written[1]:
        shape = parts[solid.name][0]
        (only,) = shape.Solids()
        assert shape.isValid()
        assert only.Volume() == pytest.approx(shown(solid).shape.Volume(), rel=1e-9)


def test_gmsh_finds_the_same_solids(written, tmp_path):
    path = tmp_path / "m.step"
    path.write_bytes(written[2])
    with in_gmsh(path) as gmsh:
        volumes = [gmsh.model.occ.getMass(3, tag) for _, tag in gmsh.model.getEntities(3)]
    assert sorted(volumes) == pytest.approx(sorted(shown(solid).shape.Volume() for solid in written[1]), rel=1e-9)


def test_rims_of_dots_are_within_a_micrometer_in_the_marker_frame(written, parts):
    marker, _, _ = written
    circles = [
        (edge.arcCenter().x, edge.arcCenter().y, edge.radius())
        for edge in parts["plate"][0].Edges()
        if edge.geomType() == "CIRCLE" and abs(edge.arcCenter().z) < MICROMETER
    ]
    for point in marker.control_points:
        expected = (1e3 * point.x, 1e3 * point.y, 500 * point.feature.diameter)
        assert np.abs(np.subtract(circles, expected)).max(axis=1).min() < MICROMETER


def test_header_has_no_time_and_units_are_mm(written):
    text = written[2].decode("ascii")
    assert "FILE_NAME('markergen-1a2b3c4d.step',''" in text
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    assert "AUTOMOTIVE_DESIGN" in text
    assert "T" not in text.split("FILE_NAME(")[1].split(",")[1]


AGAIN = """
import sys
from pathlib import Path
from markergen.model.marker import marker_name
from markergen.model.fabrication import Fabrication
from markergen.model.body_json import from_json
from markergen.workshop.formats.solids import write_brep, write_step
from markergen.workshop.formats.solids import solids_of
from markergen.workshop.processes import parts_of
marker = from_json(sys.stdin.buffer.read())
# What addresses order things by is elsewhere.
taken = [bytearray(4096 + k) for k in range(3000)]
solids = solids_of(parts_of(marker, Fabrication(sys.argv[1], engrave=sys.argv[1] == "laser")).parts)
write_step(solids[:1], "first")
Path(sys.argv[2]).write_bytes(write_step(solids, marker_name(marker)) + write_brep(solids))
"""


@WITHOUT_LETTERS
def test_another_process_writes_the_same_bytes(written, tmp_path):
    from markergen.model.body_json import to_json

    marker, solids, data = written
    process = "laser" if len(solids) == 1 else "fdm"
    subprocess.run(
        [sys.executable, "-c", AGAIN, process, str(tmp_path / "again")],
        input=to_json(marker),
        env={"PYTHONHASHSEED": "7", "PYTHONPATH": str(Path(__file__).parents[2])},
        check=True,
    )
    assert (tmp_path / "again").read_bytes() == data + write_brep(solids)


def test_settings_of_others_in_this_process_do_not_count(written):
    from OCP.Interface import Interface_Static

    marker, solids, data = written
    # As cadquery's exporter leaves it.
    assert Interface_Static.SetIVal_s("write.stepcaf.subshapes.name", 1)
    assert write_step(solids, marker_name(marker)) == data


def test_brep_is_read_with_the_same_solids(written, tmp_path):
    import cadquery

    (tmp_path / "m.brep").write_bytes(write_brep(written[1]))
    read = cadquery.Shape.importBrep(str(tmp_path / "m.brep")).Solids()
    assert all(solid.isValid() for solid in read)
    assert [solid.Volume() for solid in read] == pytest.approx([shown(s).shape.Volume() for s in written[1]], rel=1e-12)


@WITHOUT_LETTERS
def test_triangles_of_a_mesh_do_not_get_into_files(written):
    before = write_brep(written[1])
    shown(written[1][0]).shape.tessellate(0.1)
    assert write_brep(written[1]) == before
    assert write_step(written[1], marker_name(written[0])) == written[2]
    assert isinstance(written[1][0], NamedSolid)


STEP = """ISO-10303-21;
HEADER;
FILE_NAME('a','2020-01-01T00:00:00',('Author'),('b'),
  'c','d','e');
ENDSEC;
DATA;
#1 = SOLID('it''s #9',$);
#2 = SOLID('',#1);
#3 = NEXT_ASSEMBLY_USAGE_OCCURRENCE('41','x','',#1,#2,$);
{styles}ENDSEC;
END-ISO-10303-21;
"""
ROOT = "MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION"


def test_normalization_sorts_styles_renumbers_and_leaves_strings_alone():
    one = STEP.format(
        styles=f"#4 = {ROOT}('',(#5),#2);\n#5 = STYLED_ITEM('color',(#6),#2);\n#6 = COLOUR('shared');\n"
        f"#7 = {ROOT}('',(#8),#1);\n#8 = STYLED_ITEM('color',(#6),#1);\n"
    )
    other = (
        STEP.replace("2020", "2021")
        .replace("'41'", "'7'")
        .format(
            styles=f"#4 = {ROOT}('',(#5),#1);\n#5 = STYLED_ITEM('color',(#6),#1);\n#6 = COLOUR('shared');\n"
            f"#7 = {ROOT}('',(#8),#2);\n#8 = STYLED_ITEM('color',(#6),#2);\n"
        )
    )
    assert one != other
    assert normalize(one, "m") == normalize(other, "m")
    assert normalize(normalize(one, "m"), "m") == normalize(one, "m")
    assert "SOLID('it''s #9',$)" in normalize(one, "m")
    assert "OCCURRENCE('1','x'" in normalize(one, "m")
    assert "#4 = " + ROOT + "('',(#5),#1);" in normalize(one, "m")
