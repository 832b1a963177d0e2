import subprocess
import sys
from math import pi, tan

import pytest
from cad import build
from sentences import sentence

from markergen.errors import OutputError
from markergen.geometry.contour import Contour, circle
from markergen.solid.primitives import Part, Prism, Revolved, cylinder

VOLUME = 1e-9
"""Open CASCADE integrates by quadrature, which is exact to this for planes, cylinders, cones and spheres."""

QUARTER = tan(pi / 8)
SQUARE = Contour(((-50, -50), (50, -50), (50, 50), (-50, 50)))
L_SHAPE = Contour(((0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)))
ROUNDED = Contour(
    ((-48, -50), (48, -50), (50, -48), (50, 50), (-50, 50), (-50, -48)), (0.0, QUARTER, 0.0, 0.0, 0.0, QUARTER)
)


def ngon(count: int, radius: float, sign: int = 1) -> Contour:
    from math import cos, sin

    return Contour(
        tuple((radius * cos(2 * pi * k / count), sign * radius * sin(2 * pi * k / count)) for k in range(count))
    )


BODIES = {
    "disk": Prism(circle(50), (), -3, 0),
    "disk with a chamfer": Prism(circle(50, 1, 2), (), -3, 0, 1),
    "plate with holes": Prism(SQUARE, (circle(5, 20, 20, hole=True), ngon(7, 9, -1)), -3, 0),
    "rounded corners": Prism(ROUNDED, (), -3, 0),
    "rounded corners, chamfer": Prism(ROUNDED, (), -3, 0, 0.75),
    "inner corner, chamfer": Prism(L_SHAPE, (), -3, 0, 1),
    "fine outline with a hole, chamfer": Prism(ngon(120, 150), (ngon(40, 75, -1),), -3, 0, 1),
    "tube": cylinder(3, 4, 5, -1, 2, 2),
    "countersink": Revolved(3, 4, Contour(((0, -3), (2, -3), (2, -1), (3, 0), (0, 0)))),
    "ball": Revolved(3, 4, Contour(((0, -3), (0, 3)), (1, 0))),
    "half ball on a plug": Revolved(1, 2, Contour(((0, -1), (3, -1), (3, 0), (0, 3)), (0, 0, QUARTER, 0))),
    "pillar with a fillet": Revolved(
        1, 2, Contour(((0, 0), (4, 0), (3, 1), (2.5, 8), (0, 8)), (0.0, -QUARTER, 0.0, 0.0, 0.0))
    ),
}


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
def test_bodies_have_their_volume_in_closed_form(body):
    part = Part("dot-0", "dark", (body,))
    solid = build(part)
    assert (solid.name, solid.material) == ("dot-0", "dark")
    assert solid.shape.ShapeType() == "Solid"
    assert solid.shape.isValid()
    assert [shell.Closed() for shell in solid.shape.Shells()] == [True]
    assert solid.shape.Volume() == pytest.approx(part.volume, rel=VOLUME)


def test_surfaces_are_what_they_are_meant_to_be():
    def kinds(name):
        return sorted({face.geomType() for face in build(Part("plate", "light", (BODIES[name],))).shape.Faces()})

    assert kinds("rounded corners, chamfer") == ["CONE", "CYLINDER", "PLANE"]
    assert kinds("disk with a chamfer") == ["CONE", "CYLINDER", "PLANE"]
    assert kinds("inner corner, chamfer") == ["PLANE"]
    assert kinds("ball") == ["SPHERE"]
    assert kinds("pillar with a fillet") == ["CONE", "PLANE", "TORUS"]


def test_joined_and_cut_at_once():
    part = Part(
        "plate",
        "light",
        (Prism(SQUARE, (circle(5, 20, 20, hole=True),), -3, 0, 1), cylinder(-30, -30, 10, 0, 10)),
        (cylinder(0, 0, 5, -0.6, 0, 2), cylinder(0, 0, 1, -3, 0), cylinder(-30, -30, 5, 9, 10)),
        (cylinder(-20, 30, 5, -0.6, 0), Prism(circle(4, 30, -30), (circle(2, 30, -30, hole=True),), -0.5, 0)),
    )
    solid = build(part)
    assert solid.shape.isValid()
    assert solid.shape.ShapeType() == "Solid"
    assert solid.shape.Volume() == pytest.approx(part.volume, rel=VOLUME)
    # The floors of what is marked, seen from above, and as the solid has them.
    ours = {face.hashCode() for face in solid.shape.Faces()}
    assert all(face.hashCode() in ours for face in solid.marked)
    floors = sorted((round(face.Center().z, 9), face.Area(), face.normalAt().z) for face in solid.marked)
    assert [z for z, _, _ in floors] == [-0.6, -0.5]
    assert [area for _, area, _ in floors] == pytest.approx([25 * pi, 12 * pi], rel=VOLUME)
    assert [up for _, _, up in floors] == pytest.approx([1, 1])


def test_marks_that_share_a_height_with_pockets_are_told_apart():
    part = Part(
        "plate", "light", (Prism(SQUARE, (), -3, 0),), (cylinder(10, 0, 5, -1, 0),), (cylinder(-10, 0, 5, -1, 0),)
    )
    (floor,) = build(part).marked
    assert floor.Center().x == pytest.approx(-10, abs=1e-9)


@pytest.mark.parametrize(
    ("cut", "result"),
    [
        # Sticks out of the plate, cuts it in two, and leaves nothing of it.
        (cylinder(50, 0, 5, -1, 0), "edges that cross at z = 0 mm"),
        (Prism(Contour(((-60, -1), (60, -1), (60, 1), (-60, 1))), (), -3, 0), "edges that cross at z = -3 mm"),
        (cylinder(0, 0, 20, -3, 0, 10), "several pieces"),
        (cylinder(0, 0, 5, -2, -1), "several pieces"),
        (Prism(Contour(((-60, -60), (60, -60), (60, 60), (-60, 60))), (), -4, 1), "nothing"),
    ],
)
def test_what_is_not_one_sound_solid_is_told_with_its_name(cut, result):
    with pytest.raises(OutputError, match=f"the part 'plate-2', found .*{result}") as raised:
        build(Part("plate-2", "light", (Prism(SQUARE, (), -3, 0),), (cut,)))
    assert "\n" not in str(raised.value)


MISSING = """
import sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("cadquery", "OCP"):
            raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")

sys.meta_path.insert(0, Finder())
from pathlib import Path
from markergen.errors import MissingLibraryError
from markergen.exporters.saving import save
from markergen.model.body_json import from_json
marker, folder = from_json(sys.stdin.read()), Path(sys.argv[1])
save(marker, [folder / "m.pdf", folder / "m.svg", folder / "m.json"])
for suffix in sys.argv[2:]:
    try:
        save(marker, [folder / "other.json", folder / f"m{suffix}"])
    except MissingLibraryError as error:
        print(error)
"""


@pytest.mark.long
def test_a_missing_system_library_is_one_line_and_the_rest_works(make_ngon, tmp_path):
    from markergen.model.body_json import to_json

    done = subprocess.run(
        [sys.executable, "-c", MISSING, str(tmp_path), ".step", ".brep"],
        input=to_json(make_ngon(4, 0.05, 0.01)),
        capture_output=True,
        check=True,
    )
    lines = done.stdout.decode().splitlines()
    assert len(lines) == 2
    assert all("libGL.so.1: cannot open" in line for line in lines)
    assert all(sentence("install solids") in line for line in lines)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.json", "m.pdf", "m.svg"]
