"""Outline files as programs write them: name, file, area in m^2 (or that it is refused), options of the reader."""
# ruff: noqa: E501

import io
import json
import math

import ezdxf

OUTLINES = {}
REFUSED = "refused"


def add(name, text, area, **options):
    OUTLINES[name] = (text, area, options)


def dxf(build, units=4, version="R2010"):
    drawing = ezdxf.new(version, units=units)
    build(drawing, drawing.modelspace())
    stream = io.StringIO()
    drawing.write(stream)
    return stream.getvalue()


def svg(body, width="100mm", height="80mm", box="0 0 100 80"):
    return f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="{box}">{body}</svg>'


def hidden(drawing, model):
    drawing.layers.add("OFF").off()
    model.add_lwpolyline(SQ, close=True)
    model.add_circle((10, 10), 5, dxfattribs={"layer": "OFF"})


SQ = [(0, 0), (100, 0), (100, 80), (0, 80)]
add("lwpolyline mm", dxf(lambda d, m: m.add_lwpolyline(SQ, close=True)), 8000e-6)
add(
    "lwpolyline inch",
    dxf(lambda d, m: m.add_lwpolyline([(0, 0), (4, 0), (4, 3), (0, 3)], close=True), units=1),
    12 * 0.0254**2,
)
add("lwpolyline unitless", dxf(lambda d, m: m.add_lwpolyline(SQ, close=True), units=0), REFUSED)
add("lwpolyline unitless mm", dxf(lambda d, m: m.add_lwpolyline(SQ, close=True), units=0), 8000e-6, unit="mm")
add("lines", dxf(lambda d, m: [m.add_line(SQ[i], SQ[(i + 1) % 4]) for i in range(4)]), 8000e-6)
add(
    "lines shuffled reversed",
    dxf(
        lambda d, m: [
            m.add_line(SQ[(i + 1) % 4], SQ[i]) if i % 2 else m.add_line(SQ[i], SQ[(i + 1) % 4]) for i in (2, 0, 3, 1)
        ]
    ),
    8000e-6,
)
add("r12 polyline", dxf(lambda d, m: m.add_polyline2d(SQ, close=True), version="R12"), REFUSED)
add("r12 polyline mm", dxf(lambda d, m: m.add_polyline2d(SQ, close=True), version="R12"), 8000e-6, unit="mm")
add("circle", dxf(lambda d, m: m.add_circle((10, 10), 50)), math.pi * 2500e-6)
add("ring", dxf(lambda d, m: [m.add_circle((10, 10), 50), m.add_circle((10, 10), 20)]), math.pi * 2100e-6)
add(
    "slot arcs",
    dxf(
        lambda d, m: [
            m.add_line((0, 0), (60, 0)),
            m.add_arc((60, 20), 20, -90, 90),
            m.add_line((60, 40), (0, 40)),
            m.add_arc((0, 20), 20, 90, 270),
        ]
    ),
    (60 * 40 + math.pi * 400) * 1e-6,
)
add(
    "bulge",
    dxf(lambda d, m: m.add_lwpolyline([(0, 0, 0), (60, 0, 1), (60, 40, 0), (0, 40, 1)], format="xyb", close=True)),
    (60 * 40 + math.pi * 400) * 1e-6,
)
add("ellipse", dxf(lambda d, m: m.add_ellipse((0, 0), (50, 0), 0.5)), math.pi * 50 * 25e-6)
add(
    "insert",
    dxf(
        lambda d, m: (
            d.blocks.new("B").add_lwpolyline(SQ, close=True),
            m.add_blockref("B", (5, 5), dxfattribs={"xscale": 0.5, "yscale": 0.5, "rotation": 30}),
        )
    ),
    2000e-6,
)
add(
    "mirrored extrusion",
    dxf(lambda d, m: m.add_lwpolyline(SQ, close=True, dxfattribs={"extrusion": (0, 0, -1)})),
    8000e-6,
)
add("hidden layer", dxf(hidden), 8000e-6)
add(
    "construction lines",
    dxf(lambda d, m: [m.add_lwpolyline(SQ, close=True), m.add_line((0, 40), (50, 40)), m.add_line((50, 0), (50, 30))]),
    8000e-6,
)
add(
    "construction lines ignored",
    dxf(lambda d, m: [m.add_lwpolyline(SQ, close=True), m.add_line((0, 40), (50, 40)), m.add_line((50, 0), (50, 30))]),
    8000e-6,
    ignore_open=True,
)
add("hatch only", dxf(lambda d, m: m.add_hatch().paths.add_polyline_path(SQ, is_closed=True)), REFUSED)
add(
    "text and dims",
    dxf(
        lambda d, m: [
            m.add_lwpolyline(SQ, close=True),
            m.add_text("A"),
            m.add_linear_dim(base=(0, -10), p1=(0, 0), p2=(100, 0)).render(),
        ]
    ),
    8000e-6,
)
add("svg rect", svg('<rect x="0" y="0" width="100" height="80"/>'), 8000e-6)
add("svg rounded", svg('<rect width="100" height="80" rx="10"/>'), (8000 - (4 - math.pi) * 100) * 1e-6)
add("svg path rel", svg('<path d="m0,0 100,0 0,80 -100,0z"/>'), 8000e-6)
add("svg arc path", svg('<path d="M50,0 A40,40 0 0 1 50,80 A40,40 0 0 1 50,0Z"/>'), math.pi * 1600e-6)
add("svg bezier circle", svg('<circle cx="50" cy="40" r="40"/>'), math.pi * 1600e-6)
add("svg polygon", svg('<polygon points="0,0 100,0 100,80 0,80"/>'), 8000e-6)
add(
    "svg transform",
    svg('<g transform="translate(10,5) rotate(30) scale(.5)"><rect width="100" height="80"/></g>'),
    2000e-6,
)
add("svg use", svg('<defs><rect id="a" width="50" height="40"/></defs><use href="#a" x="10" y="10"/>'), 2000e-6)
add(
    "svg style none", svg('<rect width="100" height="80"/><rect style="display:none" width="10" height="10"/>'), 8000e-6
)
add(
    "svg inkscape px viewbox", svg('<rect width="377.95276" height="302.3622"/>', box="0 0 377.95276 302.3622"), 8000e-6
)
add(
    "svg px only",
    '<svg xmlns="http://www.w3.org/2000/svg" width="378" height="302"><rect width="378" height="302"/></svg>',
    REFUSED,
)
add("svg inches", svg('<rect width="4" height="3"/>', "4in", "3in", "0 0 4 3"), 12 * 0.0254**2)
add("svg two paths ring", svg('<path fill-rule="evenodd" d="M0,0H100V80H0Z M10,10H20V20H10Z"/>'), 7900e-6)
add(
    "svg boxes",
    svg(
        '<g id="p-0"><path d="M 0.000 0.000 L 100 0" stroke="rgb(0,0,0)" fill="none"/><path d="M 100 0 L 100 80 L 0 80 L 0 0"/></g>'
    ),
    8000e-6,
)
add(
    "svg nested",
    svg('<svg x="10" y="10" width="50" height="40" viewBox="0 0 100 80"><rect width="100" height="80"/></svg>'),
    2000e-6,
)
add(
    "svg clip",
    svg('<defs><clipPath id="c"><rect width="5" height="5"/></clipPath></defs><rect width="100" height="80"/>'),
    8000e-6,
)
ring = [[0, 0], [0.1, 0], [0.1, 0.08], [0, 0.08], [0, 0]]
add("geojson polygon", json.dumps({"type": "Polygon", "coordinates": [ring]}), REFUSED)
add("geojson polygon m", json.dumps({"type": "Polygon", "coordinates": [ring]}), 8000e-6, unit="m")
add(
    "geojson feature",
    json.dumps(
        {
            "type": "FeatureCollection",
            "features": [
                {
                    "type": "Feature",
                    "properties": {"a": 1},
                    "geometry": {"type": "MultiPolygon", "coordinates": [[ring]]},
                }
            ],
        }
    ),
    8000e-6,
    unit="m",
)
add(
    "geojson crs",
    json.dumps(
        {
            "type": "FeatureCollection",
            "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}},
            "features": [{"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [ring]}}],
        }
    ),
    8000e-6,
    unit="m",
)
add("topojson", json.dumps({"type": "Topology", "arcs": []}), REFUSED)
add("wkt", "POLYGON ((0 0, 100 0, 100 80, 0 80, 0 0))", REFUSED)
k = '(kicad_pcb (version 20221018) (generator pcbnew)\n (general (thickness 1.6))\n (paper "A4")\n (layers (0 "F.Cu" signal) (44 "Edge.Cuts" user))\n %s\n)\n'
add(
    "kicad7 lines",
    k
    % "\n".join(
        f' (gr_line (start {a[0]} {a[1]}) (end {b[0]} {b[1]}) (stroke (width 0.1) (type default)) (layer "Edge.Cuts") (tstamp x))'
        for a, b in zip(SQ, SQ[1:] + SQ[:1], strict=False)
    ),
    8000e-6,
)
add(
    "kicad8 rect",
    k
    % '(gr_rect (start 10 10) (end 110 90) (stroke (width 0.05) (type default)) (fill none) (layer "Edge.Cuts") (uuid "x"))',
    8000e-6,
)
add(
    "kicad5 circle",
    "(kicad_pcb (version 20171130) (host pcbnew 5.1)\n (gr_circle (center 50 50) (end 100 50) (layer Edge.Cuts) (width 0.05))\n)\n",
    math.pi * 2500e-6,
)
add(
    "kicad arcs",
    k
    % '(gr_line (start 0 0) (end 60 0) (layer "Edge.Cuts")) (gr_arc (start 60 0) (mid 80 20) (end 60 40) (layer "Edge.Cuts")) (gr_line (start 60 40) (end 0 40) (layer "Edge.Cuts")) (gr_arc (start 0 40) (mid -20 20) (end 0 0) (layer "Edge.Cuts"))',
    (2400 + math.pi * 400) * 1e-6,
)
add(
    "kicad poly",
    k
    % '(gr_poly (pts (xy 0 0) (xy 100 0) (xy 100 80) (xy 0 80)) (stroke (width 0.1) (type solid)) (fill none) (layer "Edge.Cuts"))',
    8000e-6,
)
add(
    "kicad footprint at",
    k % '(footprint "x" (layer "F.Cu") (at 10 20 30) (fp_rect (start 0 0) (end 100 80) (layer "Edge.Cuts")))',
    8000e-6,
)
add(
    "kicad mod",
    '(footprint "x" (version 20221018) (generator pcbnew) (layer "F.Cu") (fp_rect (start 0 0) (end 100 80) (stroke (width 0.05)) (layer "Edge.Cuts")))\n',
    8000e-6,
)
add(
    "kicad old module",
    "(module x (layer F.Cu) (fp_line (start 0 0) (end 100 0) (layer Edge.Cuts) (width .1)) (fp_line (start 100 0) (end 100 80) (layer Edge.Cuts) (width .1)) (fp_line (start 100 80) (end 0 80) (layer Edge.Cuts) (width .1)) (fp_line (start 0 80) (end 0 0) (layer Edge.Cuts) (width .1)))",
    8000e-6,
)
for n, t in {
    "pdf": b"%PDF-1.7\n",
    "eps": b"%!PS-Adobe-3.0 EPSF",
    "png": b"\x89PNG\r\n\x1a\n",
    "step": b"ISO-10303-21;\n",
    "dwg": b"AC1032\0",
    "stl": b"solid x\nfacet",
    "gerber": b"G04 x*\n%FSLAX46Y46*%\n",
    "zip": b"PK\x03\x04",
    "kml": b'<?xml version="1.0"?><kml xmlns="x">',
    "hpgl": b"IN;SP1;PU",
    "gcode": b"G21\nG1 X10 Y10\n",
    "sch": b"(kicad_sch (version 1))",
    "shp": b"\0\0\x27\x0a\0\0",
}.items():
    add(n, t, REFUSED)
EDGES = '(kicad_pcb (version 20240108)\n(gr_rect (start 0 0) (end 100 80) (layer "Edge.Cuts"))\n'
add("kicad text on the edge", EDGES + '(gr_text "hi" (at 1 1) (layer "Edge.Cuts")))', 8000e-6)
add(
    "kicad drilled hole",
    EDGES
    + '(footprint "M3" (at 9 9) (pad "" np_thru_hole circle (at 0 0) (size 3.2 3.2) (drill 3.2) (layers "*.Cu"))))',
    8000e-6,
)
add(
    "kicad arc more than half",
    '(kicad_pcb\n(gr_arc (start 0 -50) (mid -50 0) (end 0 50) (layer "Edge.Cuts"))\n(gr_arc (start 0 -50) (mid 50 0) (end 0 50) (layer "Edge.Cuts")))',
    math.pi * 2500e-6,
)
add(
    "geojson unit of its own",
    json.dumps({"type": "Polygon", "unit": "mm", "coordinates": [[*SQ, SQ[0]]]}),
    8000e-6,
    unit="mm",
)
add(
    "geojson key twice",
    '{"type": "Polygon", "coordinates": [], "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 0]]]}',
    REFUSED,
    unit="m",
)
