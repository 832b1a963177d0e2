from pathlib import Path

import numpy as np
import pytest

from markergen.drawing.scene import marker_name
from markergen.solid.inlay import DOT_COLOR, PLATE_COLOR, marker_solids
from markergen.solid.step import normalize, write_step

MICROMETRE = 1e-3


@pytest.fixture(scope="module")
def written(make_ngon):
    marker = make_ngon(5, 0.0413, 0.0077)
    solids = marker_solids(marker)
    return marker, solids, write_step(solids, marker_name(marker))


@pytest.fixture(scope="module")
def parts(written, tmp_path_factory) -> dict:
    """Name -> (solid, sRGB color) as a reader of the file finds them; also the name of the assembly."""
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

    roots = TDF_LabelSequence()
    shapes.GetFreeShapes(roots)
    assert roots.Length() == 1
    members = TDF_LabelSequence()
    shapes.GetComponents_s(roots.Value(1), members)
    found: dict = {"": name(roots.Value(1))}
    for index in range(1, members.Length() + 1):
        shape, part, color = shapes.GetShape_s(members.Value(index)), TDF_Label(), Quantity_Color()
        assert shapes.GetReferredShape_s(members.Value(index), part)
        assert colors.GetColor_s(part, XCAFDoc_ColorSurf, color) or colors.GetColor_s(part, XCAFDoc_ColorGen, color)
        values = tuple(color.Values(Quantity_TOC_sRGB))
        found[name(members.Value(index))] = (cadquery.Shape.cast(shape), values)
    return found


def test_names_and_number_of_solids(written, parts):
    marker, _, _ = written
    assert parts[""] == "markergen-1a2b3c4d"
    assert list(parts)[1:] == ["plate", *(f"dot-{point.id}" for point in marker.control_points)]


def test_colors(parts):
    for name, part in parts.items():
        if name:
            expected = PLATE_COLOR if name == "plate" else DOT_COLOR
            assert part[1] == pytest.approx(expected, abs=1e-4)  # colors are 32-bit floats, converted twice


def test_parts_are_valid_solids_with_the_volumes_that_were_written(written, parts):
    for solid in written[1]:
        shape = parts[solid.name][0]
        (only,) = shape.Solids()
        assert shape.isValid()
        assert only.Volume() * 1e-9 == pytest.approx(solid.shape.Volume() * 1e-9, rel=1e-9)


def test_dot_centers_are_within_a_micrometer_in_the_marker_frame(written, parts):
    marker, _, _ = written
    for point in marker.control_points:
        shape = parts[f"dot-{point.id}"][0]
        circles = [edge for edge in shape.Edges() if edge.geomType() == "CIRCLE"]
        assert len(circles) == (4 if point.feature.kind == "ring" else 2)
        for edge in circles:
            center = edge.arcCenter()
            np.testing.assert_allclose((center.x, center.y), (point.x * 1e3, point.y * 1e3), atol=MICROMETRE, rtol=0)
        assert max(edge.radius() for edge in circles) == pytest.approx(point.feature.diameter * 500, abs=MICROMETRE)
        assert max(edge.arcCenter().z for edge in circles) == pytest.approx(0, abs=MICROMETRE)


def test_header_has_no_time_and_units_are_mm(written):
    text = written[2].decode("ascii")
    assert "FILE_NAME('markergen-1a2b3c4d.step',''" in text
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    assert "T" not in text.split("FILE_NAME(")[1].split(",")[1]


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
