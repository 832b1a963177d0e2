"""Every process on markers of all kinds: what it makes are sound solids of known volume that share no room."""

from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, product
from math import cos, pi, sin

import numpy as np
import pytest
from cad import solids_of

from markergen.errors import InputError
from markergen.geometry.contour import area, flattened
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.substrate import Hole, Substrate
from markergen.model.tag import Tag
from markergen.solid.plate import plate_of
from markergen.solid.primitives import Part, Prism, Revolved
from markergen.workshop.dot_geometry import dots_of
from markergen.workshop.processes import parts_of

VOLUME = 1e-6
"""Share: Open CASCADE integrates volumes of planes, cylinders, cones, balls and tori to about 1e-9; asked are 1e-4."""

OVERLAP = 1e-6
"""mm^3."""

PLACE = 1e-6
"""mm: whole picometers, through the kernel's rounding of 1e-7."""

VARIANTS = {
    name: replace(fabrication, engrave=False)
    for name, fabrication in {
        "fdm": Fabrication("fdm"),
        "fdm with a gap": Fabrication("fdm", gap=1e-4),
        "cnc slip": Fabrication("cnc"),
        "cnc press": Fabrication("cnc", fit="press", draft=0.05),
        "cnc through": Fabrication("cnc", through=True),
        "laser": Fabrication("laser"),
        "print": Fabrication("print"),
        "half-balls": Fabrication("dome"),
        "balls": Fabrication("dome", dome="ball", gap=5e-5),
    }.items()
}
"""With blank backs: letters are no business of a process, and take the kernel longer than all else."""

MOUNT = tuple(
    Hole(0.06 * cos(a), 0.06 * sin(a), 0.0034, sink, "mount", "M3")
    for a, sink in zip((pi / 4, 3 * pi / 4, 5 * pi / 4, 7 * pi / 4), (0.0, 0.0068, 0.0, 0.0068), strict=True)
)

FEATURES = [(relief, tag, mount) for relief, tag, mount in product((False, True), repeat=3)]
QUICK = [(5, *features) for features in FEATURES if sum(features) in (0, 3)]


@pytest.fixture(scope="module")
def make(make_ngon) -> Callable[..., Marker]:
    """Marker with n dots; every second one raised, a tag in its middle, and four holes for screws, if so wanted."""

    def made(n: int, relief: bool = False, tag: bool = False, mount: bool = False) -> Marker:
        marker = make_ngon(n, 0.15, min(0.036, 0.28 / n))
        heights = [0.015 + 0.001 * i if relief and i % 2 else 0.0 for i in range(n)]
        points = tuple(replace(p, z=z) for p, z in zip(marker.control_points, heights, strict=True))
        return replace(
            marker,
            control_points=points,
            tag=Tag("aruco:DICT_6X6_250", 23, 0.05) if tag else None,
            substrate=Substrate(holes=MOUNT if mount else ()),
        )

    return made


def test_the_table_has_all_processes_and_no_other():
    assert PROCESSES.names() == ["cnc", "dome", "fdm", "laser", "print"]


def check_solids(marker: Marker, fabrication: Fabrication) -> None:
    made = parts_of(marker, fabrication)
    parts, solids = made.parts, solids_of(made.parts)
    assert [part.name for part in parts] == [solid.name for solid in solids]
    assert len({part.name for part in parts}) == len(parts)
    for part, solid in zip(parts, solids, strict=True):
        assert solid.shape.isValid(), part.name
        assert solid.shape.ShapeType() == "Solid"
        assert solid.shape.Shells()[0].Closed(), part.name
        assert solid.shape.Volume() == pytest.approx(part.volume, rel=VOLUME), part.name
    shapes = [(solid.shape, solid.shape.BoundingBox()) for solid in solids]
    for (one, a), (other, b) in combinations(shapes, 2):
        apart = a.xmin > b.xmax or b.xmin > a.xmax or a.ymin > b.ymax or b.ymin > a.ymax or a.zmin > b.zmax
        if not apart:
            assert one.intersect(other).Volume() <= OVERLAP


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("n", "relief", "tag", "mount"), QUICK)
def test_solids_are_sound(make, variant, n, relief, tag, mount):
    if variant == "balls" and tag:
        pytest.skip("refused: see test_balls_stand_before_the_plate")
    check_solids(make(n, relief, tag, mount), VARIANTS[variant])


@pytest.mark.long
@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("n", [4, 5, 12])
@pytest.mark.parametrize(("relief", "tag", "mount"), FEATURES)
def test_solids_are_sound_in_all_combinations(make, variant, n, relief, tag, mount):
    if variant == "balls" and tag:
        pytest.skip("refused: see test_balls_stand_before_the_plate")
    check_solids(make(n, relief, tag, mount), VARIANTS[variant])


@pytest.mark.parametrize("variant", VARIANTS)
def test_plain_data_is_the_same_every_time(make, variant):
    marker = make(5, relief=True, tag=variant != "balls")
    assert parts_of(marker, VARIANTS[variant]) == parts_of(marker, VARIANTS[variant])


@pytest.mark.parametrize("variant", [name for name in VARIANTS if "balls" not in name and name != "print"])
@pytest.mark.parametrize("relief", [False, True])
def test_rims_of_dots_are_where_the_marker_says(make, variant, relief):
    """Every dot is a round edge at its center and height, of its radius, of the inlay or of what is cut for it."""
    marker, fabrication = make(5, relief), VARIANTS[variant]
    solids = {solid.name: solid.shape for solid in solids_of(parts_of(marker, fabrication).parts)}
    for dot in dots_of(marker):
        shape = solids.get(dot.name, solids["plate"])
        for radius in filter(None, (dot.radius, dot.inner)):
            rims = [
                edge.Center()
                for edge in shape.Edges()
                if edge.geomType() == "CIRCLE" and abs(edge.radius() - radius) < PLACE
            ]
            result = [c for c in rims if abs(c.z - dot.z) < PLACE and np.hypot(c.x - dot.x, c.y - dot.y) < PLACE]
            assert result, (dot, radius)


@pytest.mark.parametrize("dome", ["half", "ball"])
def test_balls_have_their_middles_in_the_control_points(make, dome):
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    marker = make(5, relief=True)
    solids = {
        solid.name: solid.shape
        for solid in solids_of(parts_of(marker, Fabrication("dome", dome=dome, engrave=False)).parts)
    }
    for dot in dots_of(marker):
        balls = [
            BRepAdaptor_Surface(face.wrapped).Sphere()
            for face in solids[dot.name].Faces()
            if face.geomType() == "SPHERE"
        ]
        assert balls
        for ball in balls:
            middle = ball.Location()
            assert (middle.X(), middle.Y(), middle.Z()) == pytest.approx((dot.x, dot.y, dot.z), abs=PLACE)
            assert ball.Radius() == pytest.approx(dot.radius, abs=PLACE)


def by_name(parts: tuple[Part, ...]) -> dict[str, Part]:
    return {part.name: part for part in parts}


def test_a_key_dot_is_a_dark_ring_around_a_light_core(make):
    marker = make(5)
    made = PROCESSES["fdm"](marker, Fabrication(gap=1e-4))
    ring, core, dot = (by_name(made.parts)[name] for name in ("dot-0", "dot-0-core", "dot-1"))
    assert (ring.material, core.material, dot.material) == ("dark", "light", "dark")
    r = marker.dot_diameter * 500
    assert ring.volume == pytest.approx(pi * 0.6 * (r**2 - (r / 2) ** 2))
    assert core.volume == pytest.approx(pi * 0.6 * (r / 2 - 0.1) ** 2)
    assert dot.volume == pytest.approx(pi * 0.6 * r**2)
    assert [body.volume for body in made.cut] == pytest.approx([pi * 0.6 * (r + 0.1) ** 2] * 5)


def test_fits_are_those_of_the_standard(make):
    marker = make(5)
    slip, press = (PROCESSES["cnc"](marker, Fabrication("cnc", fit=fit)) for fit in ("slip", "press"))
    # 36 mm: F8 is +25 to +64 um of the diameter, h7 0 to -25 um, P7 -42 to -17 um, h6 0 to -16 um; 18 mm: F8 +16 um.
    (_, loose), (_, tight) = slip.fits[0], press.fits[0]
    assert (loose.disc.words, loose.pocket.words) == ("h7 (0 / -0.025)", "F8 (+0.064 / +0.025)")
    assert (tight.disc.words, tight.pocket.words) == ("h6 (0 / -0.016)", "P7 (-0.017 / -0.042)")
    assert [(what, fit.disc.diameter) for what, fit in slip.fits] == [("dot", 36), ("core", 18)]
    # Half of the zone for the pocket, and all of the play: (64 + 25) / 2 um.
    assert slip.accuracy.center == pytest.approx(0.02 + 0.0445)
    assert press.accuracy.center == pytest.approx(0.02)
    pockets = [{round(max(r for r, _ in body.profile.points), 6) for body in made.cut} for made in (slip, press)]
    assert pockets == [{18.0125}, {18.0}]
    assert {max(r for r, _ in part.add[0].profile.points) for part in slip.parts} == {18.0, 8.992}
    assert any("0.045 mm" in line for line in slip.lines)


def test_through_dots_are_holes_and_nothing_falls_out(make):
    marker = make(5, relief=True, tag=True)
    made = parts_of(marker, Fabrication("cnc", through=True, engrave=False))
    assert [part.name for part in made.parts[:3]] == ["plate", "dot-0", "dot-0-core"]
    assert all(part.name.startswith("tag-") for part in made.parts[3:])
    spans = [(min(z for _, z in body.profile.points), max(z for _, z in body.profile.points)) for body in made.cut[1:5]]
    assert spans == [(-3.0, dot.z) for dot in dots_of(marker)[1:]]
    assert any("dot-0 and the tag" in note for note in made.notes)


def test_a_sheet_with_nothing_but_holes_may_be_thin_and_has_no_words_about_discs(make):
    marker = make(5)
    points = tuple(replace(p, feature=marker.control_points[1].feature) for p in marker.control_points)
    thin = replace(marker, control_points=points, substrate=Substrate(thickness=0.0002))
    (plate,) = parts_of(thin, Fabrication("cnc", through=True)).parts
    dots = sum(pi * dot.radius**2 for dot in dots_of(thin))
    assert plate.volume == pytest.approx((pi * plate_of(thin).outlines[0][0].as_circle[2] ** 2 - dots) * 0.2)
    check_solids(thin, Fabrication("cnc", through=True))
    made = PROCESSES["cnc"](thin, Fabrication("cnc", through=True))
    assert not made.tolerances
    assert not made.fits
    assert made.accuracy.play == 0
    assert not any("disc" in line or "pocket" in line for line in made.lines)
    with pytest.raises(InputError, match="for pockets"):
        PROCESSES["cnc"](replace(marker, substrate=thin.substrate), Fabrication("cnc", through=True))


def test_engraving_is_marked_and_has_no_parts(make):
    marker = make(5, relief=True, tag=True)
    solids = solids_of(parts_of(marker, Fabrication("laser", engrave=False)).parts)
    assert [solid.name for solid in solids] == ["plate"]
    ink = sum(face.Area() for face in solids[0].marked)
    dots = sum(pi * (dot.radius**2 - dot.inner**2) for dot in dots_of(marker))
    tag = sum(
        area(b.outer) + sum(map(area, b.holes))
        for b in PROCESSES["laser"](marker, Fabrication("laser")).marked
        if isinstance(b, Prism)
    )
    assert ink == pytest.approx(dots + tag, rel=VOLUME)


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_tags_are_inlaid_in_pieces_that_touch_nowhere(make, gap):
    """Of the ink nothing is lost but corners that would meet, and there a wall of a line's width is left."""
    import shapely

    for number in range(12):
        marker = replace(make(5), tag=Tag("aruco:DICT_4X4_50", number, 0.05))
        made = PROCESSES["fdm"](marker, Fabrication(gap=gap))
        pockets = [body for body in made.cut if isinstance(body, Prism)]
        shapes = [
            shapely.Polygon(flattened(b.outer, 1e-4), [flattened(hole, 1e-4) for hole in b.holes]) for b in pockets
        ]
        assert all(shape.is_valid for shape in shapes)
        # Arcs are taken for polygons that are 0.1 um off.
        assert all(one.distance(other) >= 0.4 - 1e-3 for one, other in combinations(shapes, 2))
        # Walls between parts of one pocket: nothing closes up if it grows by less than half a wall.
        assert all(len(shape.buffer(0.19).interiors) == len(shape.interiors) for shape in shapes)
        inlays = [part.add[0] for part in made.parts if part.name.startswith("tag")]
        ink = marker.tag.ink.sum() * (50 / marker.tag.cells) ** 2
        radius = (0.4 + 2 * gap * 1e3) / (2 * (2**0.5 - 1))
        lost = [area(b.outer) + sum(map(area, b.holes)) for b in inlays]
        corners = (ink - sum(lost)) / ((1 - pi / 4) * radius**2)
        assert corners == pytest.approx(2 * _meetings(marker.tag.ink), abs=1e-6)


def _meetings(ink: np.ndarray) -> int:
    """Places where black cells meet in a corner and nowhere else."""
    a, b, c, d = ink[:-1, :-1], ink[:-1, 1:], ink[1:, :-1], ink[1:, 1:]
    return int(np.sum((a & d & ~b & ~c) | (b & c & ~a & ~d)))


def test_a_milled_tag_has_the_mills_radius_in_all_its_corners(make):
    made = PROCESSES["cnc"](make(5, tag=True), Fabrication("cnc", tool=0.003))
    for body in (*(part.add[0] for part in made.parts if part.name.startswith("tag")), *made.cut):
        if isinstance(body, Prism):
            for path in (body.outer, *body.holes):
                for i, bulge in enumerate(path.bulges):
                    (x, y), (u, v) = path.points[i], path.points[(i + 1) % len(path.points)]
                    if bulge:
                        # A quarter turn has a chord of sqrt(2) radii; around the pocket's islands the gap is missing.
                        assert np.hypot(u - x, v - y) / 2**0.5 == pytest.approx(1.5, abs=0.02)
                    else:
                        before = path.bulges[i - 1]
                        assert before, "a sharp corner"


def test_a_sheet_lies_in_a_recess_of_the_boundarys_outline(shape, make_in, on_wider_plate):
    marker = on_wider_plate(make_in(shape, 5, 0.012))
    recesses = PROCESSES["print"](marker, Fabrication("print", gap=0.0)).cut
    # Around the holes, which go through the plate, there is land.
    outside = shape.region.filled() - shape.region
    lands = outside.offset(0.001, "miter") if outside else outside
    assert sum(recess.volume for recess in recesses) == pytest.approx((shape.region - lands).area * 2e5, rel=1e-7)
    check_solids(marker, VARIANTS["print"])


def test_around_a_screw_in_the_recess_there_is_land(make):
    made = PROCESSES["print"](make(5, mount=True), Fabrication("print"))
    (recess,) = made.cut
    assert [area(hole) for hole in recess.holes] == pytest.approx([-pi * (r + 1.0) ** 2 for r in (1.7, 3.4, 1.7, 3.4)])
    assert any("Punch" in note for note in made.notes)


@pytest.mark.parametrize(
    "variant", ["fdm", "laser", *(pytest.param(name, marks=pytest.mark.long) for name in ("cnc slip", "half-balls"))]
)
def test_any_boundary_is_a_plate_for_every_process(shape, make_in, variant):
    check_solids(make_in(shape, 5, 0.012), VARIANTS[variant])


def test_balls_stand_before_the_plate(make):
    marker = make(5)
    made = PROCESSES["dome"](marker, Fabrication("dome", dome="ball"))
    assert made.face == pytest.approx(-27.0)
    assert {max(z for _, z in body.profile.points) for body in made.cut} == {-27.0}
    ball = by_name(made.parts)["dot-1"]
    # The ball, and under it the neck to the plug's end at -28.5 mm, less the cap of the ball within the neck.
    r, neck = 18.0, 7.2
    low = (r**2 - neck**2) ** 0.5
    cap = pi * (r - low) ** 2 * (2 * r + low) / 3
    assert ball.volume == pytest.approx(4 / 3 * pi * r**3 - cap + pi * neck**2 * (28.5 - low))
    ring, core = (by_name(made.parts)[name] for name in ("dot-0", "dot-0-core"))
    # A napkin ring depends on its height alone.
    assert ring.volume == pytest.approx(pi / 6 * (2 * (r**2 - (r / 2) ** 2) ** 0.5) ** 3)
    assert core.material == "light"
    with pytest.raises(InputError, match="a tag for balls"):
        PROCESSES["dome"](make(5, tag=True), Fabrication("dome", dome="ball"))


def test_thin_plates_have_pockets_half_as_deep(make):
    marker = replace(make(5), substrate=Substrate(thickness=0.0008))
    assert {PROCESSES[name](marker, Fabrication(name)).depth for name in ("fdm", "cnc", "dome")} == {0.4}


def test_what_was_measured_is_made_as_it_was_designed(make):
    marker = make(5)
    stretched = replace(
        marker,
        control_points=tuple(replace(p, x=p.x * 0.99, y=p.y * 1.01) for p in marker.control_points),
        print_scale=(0.99, 1.01),
    )
    assert parts_of(stretched, Fabrication()).parts == parts_of(marker, Fabrication()).parts


def test_every_process_has_words_for_the_workshop(make):
    for name in PROCESSES:
        made = PROCESSES[name](make(5), Fabrication(name))
        assert made.lines
        assert made.accuracy.position or made.tolerances
        assert made.depth > 0
        assert all(line.endswith(".") for line in (*made.lines, *made.notes))
        assert all(isinstance(body, Prism | Revolved) for body in (*made.cut, *made.marked, *made.add))
