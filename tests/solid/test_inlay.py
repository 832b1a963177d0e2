import subprocess
import sys

import numpy as np
import pytest

from markergen.errors import InputError
from markergen.solid.inlay import POCKET, marker_solids, plate_radius_mm, plate_size

# Open CASCADE integrates volumes of cylinders by quadrature that is exact to about 1e-9 of the value.
VOLUME = 1e-7


@pytest.mark.parametrize(("n", "radius", "diameter"), [(5, 0.15, 0.036), (8, 0.03, 0.005)])
def test_volumes_in_closed_form(make_ngon, n, radius, diameter):
    marker = make_ngon(n, radius, diameter)
    solids = marker_solids(marker)
    assert [solid.name for solid in solids] == ["plate", *(f"dot-{i}" for i in range(n))]
    disk = np.pi / 4 * diameter**2 * POCKET * 1e-3
    ring = 0.75 * disk
    plate = np.pi * (plate_radius_mm(marker) * 1e-3) ** 2 * marker.thickness - ring - (n - 1) * disk
    assert [solid.shape.Volume() * 1e-9 for solid in solids] == pytest.approx(
        [plate, ring, *[disk] * (n - 1)], rel=VOLUME
    )
    assert all(solid.shape.isValid() for solid in solids)
    assert all(solid.shape.ShapeType() == "Solid" for solid in solids)


def test_face_is_flush_at_zero_and_nothing_overlaps(make_ngon):
    solids = marker_solids(make_ngon(5, 0.05, 0.01))
    boxes = [solid.shape.BoundingBox() for solid in solids]
    # Bounding boxes are widened by the shapes' tolerance of 1e-7 mm.
    assert [box.zmax for box in boxes] == pytest.approx([0] * 6, abs=1e-6)
    assert [box.zmin for box in boxes] == pytest.approx([-3, *[-POCKET] * 5], abs=1e-6)
    plate, *dots = (solid.shape for solid in solids)
    assert all(plate.intersect(dot).Volume() < 1e-6 for dot in dots)
    assert plate.fuse(*dots).Volume() == pytest.approx(plate.Volume() + sum(d.Volume() for d in dots), rel=VOLUME)


def test_plate_holds_every_quiet_zone_and_the_boundary(make_ngon):
    wide = make_ngon(5, 0.15, 0.036)
    assert plate_radius_mm(wide) == pytest.approx(128.4 + 36)
    assert plate_radius_mm(make_ngon(5, 0.15, 0.002)) == pytest.approx(152)


def test_plates_have_the_boundarys_outline_holes_and_all(shape, make_in):
    marker = make_in(shape, 5, 0.01)
    solids = marker_solids(marker)
    plates = [solid for solid in solids if solid.name.startswith("plate")]
    assert [solid.name for solid in solids[len(plates) :]] == [f"dot-{i}" for i in range(5)]
    pockets = sum(solid.shape.Volume() for solid in solids[len(plates) :])
    volume = sum(plate.shape.Volume() for plate in plates)
    assert volume == pytest.approx(1e9 * shape.area * marker.thickness - pockets, rel=VOLUME)
    assert all(solid.shape.isValid() and solid.shape.ShapeType() == "Solid" for solid in solids)
    boxes = [plate.shape.BoundingBox() for plate in plates]
    corners = 1e3 * np.concatenate(shape.outlines())
    # Bounding boxes are widened by the shapes' tolerance of 1e-7 mm.
    found = [
        min(b.xmin for b in boxes),
        min(b.ymin for b in boxes),
        max(b.xmax for b in boxes),
        max(b.ymax for b in boxes),
    ]
    assert found == pytest.approx([*corners.min(axis=0), *corners.max(axis=0)], abs=1e-6)
    assert {(round(b.zmin, 6), round(b.zmax, 6)) for b in boxes} == {(-3.0, 0.0)}


def test_each_region_is_a_plate(shapes, make_in):
    marker = make_in(shapes["two squares"], 5, 0.01)
    names = [solid.name for solid in marker_solids(marker)]
    assert names[:3] == ["plate-1", "plate-2", "dot-0"]
    assert plate_size(marker) == "260 x 100 mm"
    (plate, *_) = marker_solids(make_in(shapes["plate"], 5, 0.01))
    # Through the plate and each hole: outside, and the sides of four holes of 64 edges.
    assert len([face for face in plate.shape.Faces() if face.geomType() == "PLANE"]) >= 4 + 4 * 64 + 2


def test_thin_plate_has_pockets_half_as_deep(make_ngon):
    from dataclasses import replace

    solids = marker_solids(replace(make_ngon(4, 0.05, 0.01), thickness=0.0008))
    assert solids[1].shape.BoundingBox().zmin == pytest.approx(-0.4, abs=1e-6)


def test_bare_points_are_refused(make_ngon):
    with pytest.raises(InputError, match="diameter 0"):
        marker_solids(make_ngon(4, 0.05, 0.0))


MISSING = """
import sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("cadquery", "OCP"):
            raise ImportError("libGL.so.1: cannot open shared object file: No such file or directory")

sys.meta_path.insert(0, Finder())
from pathlib import Path
from markergen.errors import MissingLibraryError
from markergen.export import save
from markergen.model.marker_json import from_json
marker, folder = from_json(sys.stdin.read()), Path(sys.argv[1])
save(marker, [folder / "m.pdf", folder / "m.svg", folder / "m.json"])
try:
    save(marker, [folder / "other.json", folder / "m.step"])
except MissingLibraryError as error:
    print(error)
"""


def test_a_missing_system_library_is_one_line_and_the_rest_works(make_ngon, tmp_path):
    from markergen.model.marker_json import to_json

    done = subprocess.run(
        [sys.executable, "-c", MISSING, str(tmp_path)],
        input=to_json(make_ngon(4, 0.05, 0.01)),
        capture_output=True,
        check=True,
    )
    (line,) = done.stdout.decode().splitlines()
    assert "libGL.so.1: cannot open shared object file" in line
    assert "apt-get install libgl1 libx11-6" in line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.json", "m.pdf", "m.svg"]
