"""What SVG draws, and what of it is seen."""

import numpy as np
import pytest
import shapely
from drawings import SQUARE, bounds, geojson, read_outline, svg
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ('<rect x="1" y="2" width="30" height="40"/>', [1, -42, 31, -2]),
        ('<rect x="1mm" y="2" width="50%" height="10%"/>', [96 / 25.4, -12, 96 / 25.4 + 100, -2]),
        ('<rect x="1" y="2" width="30" height="40" rx="5"/>', [1, -42, 31, -2]),
        ('<circle cx="50" cy="40" r="7"/>', [43, -47, 57, -33]),
        ('<ellipse cx="50" cy="40" rx="7" ry="9"/>', [43, -49, 57, -31]),
        ('<polygon points="1,2 30,2 30,20"/>', [1, -20, 30, -2]),
        ('<polyline points="1 2 30 2 30 20 1 2"/>', [1, -20, 30, -2]),
        ('<path d="m1 2h29v18z"/>', [1, -20, 30, -2]),
        ('<g transform="translate(5,6)"><g transform="scale(2)"><circle r="1"/></g></g>', [3, -8, 7, -4]),
        ('<g transform="translate(5 6) scale(2 3)"><circle r="1"/></g>', [3, -9, 7, -3]),
        ('<rect width="4" height="2" transform="rotate(90)"/>', [-2, -4, 0, 0]),
        ('<rect width="4" height="2" transform="rotate(90 4 0)"/>', [2, 0, 4, 4]),
        ('<rect width="4" height="2" transform="skewX(45)"/>', [0, -2, 6, 0]),
        ('<rect width="4" height="2" transform="skewY(45)"/>', [0, -6, 4, 0]),
        ('<rect width="4" height="2" transform="matrix(0 1 1 0 5 6)"/>', [5, -10, 7, -6]),
        ('<defs><circle id="c" r="2"/></defs><use href="#c" x="5" y="6" transform="scale(2)"/>', [6, -16, 14, -8]),
        ('<symbol id="s" viewBox="0 0 2 2"><circle cx="1" cy="1" r="1"/></symbol>'
         '<use xlink:href="#s" x="5" y="6" width="10" height="20"/>', [5, -21, 15, -11]),
        ('<svg x="10" y="20" width="100" height="50" viewBox="0 0 10 10"><circle r="1"/></svg>', [30, -25, 40, -15]),
        ('<svg x="10" y="20"><circle r="1"/></svg>', [9, -21, 11, -19]),
        ('<svg viewBox="0 0 10 10" preserveAspectRatio="xMinYMax slice"><circle r="1"/></svg>', [-20, 80, 20, 120]),
        ('<switch><foreignObject/><g><circle r="2"/></g></switch>', [-2, -2, 2, 2]),
        ('<switch><g requiredExtensions="http://ns.adobe.com/"><circle r="9"/></g><g><circle r="2"/></g>'
         '<circle r="5"/></switch><circle r="8" requiredExtensions="http://ns.adobe.com/"/>', [-2, -2, 2, 2]),
        ('<switch><circle r="9" systemLanguage="de"/><circle r="2"/></switch>', [-2, -2, 2, 2]),
        ('<a href="http://example.com"><circle r="2"/></a>', [-2, -2, 2, 2]),
    ],
)  # fmt: skip
def test_where_shapes_lie(write, body, expected):
    # Sampled at quarter turns, circles have their extent to rounding.
    np.testing.assert_allclose(bounds(read_outline(write(svg(body)))), expected, atol=1e-5)


@settings(max_examples=25)
@given(st.lists(st.sampled_from(["translate(3,-4)", "rotate(30)", "rotate(-70 5 8)", "scale(1.5,-0.7)", "skewX(20)",
                                 "skewY(-10)", "matrix(1 .2 -.3 1 4 5)"]), min_size=1, max_size=4))  # fmt: skip
def test_transforms_as_svgelements_sees_them(tmp_path_factory, transforms):
    from svgelements import Matrix, Point

    path = tmp_path_factory.mktemp("svg") / "a.svg"
    corners = [(10, 10), (50, 10), (50, 30), (20, 45)]
    polygon = f'<polygon points="{" ".join(f"{x},{y}" for x, y in corners)}"/>'
    for transform in reversed(transforms):
        polygon = f'<g transform="{transform}">{polygon}</g>'
    path.write_text(svg(polygon))
    matrix = Matrix(" ".join(transforms))
    points = [matrix.point_in_matrix_space(Point(*corner)) for corner in corners]
    expected = shapely.Polygon([(point.x / 1e3, -point.y / 1e3) for point in points])
    assert expected.symmetric_difference(shapely.Polygon(read_outline(path)[0])).area <= 1e-14


@pytest.mark.parametrize(
    "hidden",
    [
        '<circle r="2" display="none"/>',
        '<circle r="2" style="fill:red; display: none"/>',
        '<g style="display:none"><circle r="2"/></g>',
        '<g visibility="hidden"><circle r="2"/></g>',
        '<circle r="2" fill="none"/>',
        '<circle r="2" class="a b"/>',
        '<circle r="2" id="x"/>',
        '<circle r="0"/>',
        '<rect width="5"/>',
        '<defs><circle r="2"/></defs><clipPath><circle r="2"/></clipPath><pattern><circle r="2"/></pattern>',
        '<path d="none"/>',
        '<title>a</title><metadata><b/></metadata>',
    ],
)  # fmt: skip
def test_what_is_not_seen_is_no_outline(write, hidden):
    style = "<style><![CDATA[/* .b{} */ .a, .c { display:none } #x{fill:none;stroke:none}]]></style>"
    seen = '<rect x="50" y="50" width="9" height="9" style="fill:none;stroke:#000"/>'
    assert bounds(read_outline(write(svg(style + hidden + seen)))) == [50, -59, 59, -50]


def test_layers_of_svg(write, refused):
    body = (
        '<g inkscape:groupmode="layer" inkscape:label="Cut" id="l1" style="display:none" transform="scale(2)">'
        '<g id="inner"><circle r="3"/></g></g>'
        '<g inkscape:groupmode="layer" inkscape:label="Rest" id="l2"><circle r="5"/><line x2="9"/></g>'
    )
    path = write(svg(body))
    for name in ("Cut", "l1", "inner"):
        assert bounds(read_outline(path, layer=name)) == [-6, -6, 6, 6]
    assert "a known layer" in refused(path, layer="cut")
    assert "known layers: 'Cut', 'Rest'" in refused(path, layer="cuts")
    assert "known layers: 'a'" in refused(svg('<g id="a"/>'), layer="b")
    assert "no layers" in refused(svg('<circle r="5"/>'), layer="b")
    assert "no layers" in refused(geojson(SQUARE), layer="b", unit="mm")
    assert "and 18 more" in refused(svg("".join(f'<g id="a{i}"/>' for i in range(30))), layer="b")


def test_clips_that_cut_nothing_are_left_alone(write):
    clip = '<clipPath id="c"><rect width="200" height="100"/></clipPath>'
    body = f'{clip}<g style="clip-path:url(#c)"><rect width="200" height="100"/><circle cx="50" cy="50" r="5"/></g>'
    assert bounds(read_outline(write(svg(body)))) == [0, -100, 200, 0]


def test_a_document_type_of_the_w3c_is_harmless(write):
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "http://www.w3.org/Graphics/SVG/1.1/DTD/svg11.dtd">'
    text = f'<?xml version="1.0" encoding="{{}}"?>{doctype}' + svg('<circle r="5"/>')
    for encoding in ("utf-8", "utf-16", "iso-8859-1"):
        assert len(read_outline(write(text.format(encoding).encode(encoding)))) == 1


def test_bombs_of_uses_and_entities_are_refused(refused):
    uses = "".join(f'<g id="u{i}">' + f'<use href="#u{i - 1}"/>' * 10 + "</g>" for i in range(1, 12))
    assert "10000 elements" in refused(svg(f'<defs><path id="u0" d="M0 0h1v1z"/>{uses}</defs><use href="#u11"/>'))
    entities = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
    doctype = f'<!DOCTYPE svg [<!ENTITY e0 "aaaaaaaaaa">{entities}]>'
    assert "entity declarations" in refused(doctype + svg("<text>&e11;</text>"))


def test_a_shape_without_an_id_is_named_by_its_number_in_the_file(refused):
    shapes = '<rect width="90" height="90"/><circle cx="40" cy="40" r="5"/><circle cx="20" cy="20" r="-5"/>'
    assert "-5 for circle number 3;" in refused(svg(shapes))
