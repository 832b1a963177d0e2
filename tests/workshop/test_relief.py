"""Pillars: their shape, what they stand clear of, and what they hide."""

from dataclasses import replace
from math import pi, radians, tan

import numpy as np
import pytest
from sentences import pattern

from markergen.errors import InputError
from markergen.model.boundary import polygon_from
from markergen.model.fabrication import PROCESSES, Fabrication
from markergen.model.marker import Marker
from markergen.model.occlusion import pillar_radius
from markergen.model.poses import PoseDistribution
from markergen.model.spec import Spec
from markergen.model.substrate import Hole, Substrate
from markergen.solid.plate import plate_of
from markergen.workshop.dot_geometry import SolidDot, dots_of
from markergen.workshop.manufacturability import Tool
from markergen.workshop.relief import Pillar, balls_hide, designed_poses, pillar_hiding_most, pillars_of

TOOL = Tool("nozzle", 0.4, 0.4)
DOT = SolidDot(1, 10.0, 20.0, 30.0, 8.0)


def frustum(low: float, high: float, height: float) -> float:
    return pi / 3 * height * (low**2 + low * high + high**2)


@pytest.mark.parametrize("draft", [0.0, 0.1])
def test_volume_of_wall_draft_and_fillet(draft):
    plain = Pillar(DOT, 9.0, draft)
    assert plain.base == pytest.approx(9 + 30 * tan(draft))
    assert plain.body.volume == pytest.approx(frustum(plain.base, 9.0, 30.0))
    footed = replace(plain, foot=2.0)
    # What the fillet adds, by slices of a hundredth of a micrometer's worth: the rings between wall and arc.
    z = (np.arange(200_000) + 0.5) / 200_000 * footed.tangent * np.cos(draft)
    wall = plain.base - z * tan(draft)
    arc = footed.reach - np.sqrt(2.0**2 - (2.0 - z) ** 2)
    added = float(np.sum(pi * (arc**2 - wall**2)) * (z[1] - z[0]))
    # The arc is steep at the plate, where the sum of slices is off by 1e-6 of it.
    assert footed.body.volume - plain.body.volume == pytest.approx(added, rel=1e-5)


def test_a_fillet_meets_wall_and_plate_smoothly():
    pillar = Pillar(DOT, 9.0, 0.2, 3.0)
    (_, _), (reach, zero), (side, height), *_ = pillar.body.profile.points
    center = np.array([reach, 3.0])
    assert zero == 0
    assert np.hypot(*(center - [side, height])) == pytest.approx(3.0)
    wall = np.array([np.sin(0.2), -np.cos(0.2)])
    assert (center - [side, height]) @ wall == pytest.approx(0.0, abs=1e-12)


def test_cones_cover_the_pillar_closely():
    pillar = Pillar(DOT, 9.0, 0.2, 3.0)
    tops, radii, slopes = pillar.cones()
    z = np.linspace(0.0, 29.9, 1000)
    cones = np.where(z < tops[:, None], radii[:, None] + slopes[:, None] * (tops[:, None] - z), 0.0).max(axis=0)
    arc = pillar.reach - np.sqrt(np.maximum(0.0, 9.0 - (3.0 - z) ** 2))
    body = np.where(z < pillar.tangent * np.cos(0.2), arc, 9.0 + (30 - z) * tan(0.2))
    assert (cones >= body - 1e-9).all()
    # A chord of a third of the fillet's turn is off the arc by radius times 1 - cos of half of it.
    assert (cones - body).max() < 3.0 * (1 - np.cos((pi / 2 - 0.2) / 6)) / np.cos(
        pi / 2 - 0.2 - (pi / 2 - 0.2) / 6
    ) + 0.5


@pytest.fixture
def two(make_ngon):
    """Flat ring at the origin, and a 20 mm dot raised by 20 mm at x mm from it; others out of the way."""

    def made(x: float, z: float = 20.0, flat: float = 0.0) -> Marker:
        marker = make_ngon(4, 0.15, 0.02)
        places = [(0, 0, flat), (x, 0, z), (-0.1e3, 50, 0), (-0.1e3, -50, 0)]
        points = tuple(
            replace(p, x=a / 1e3, y=b / 1e3, z=c / 1e3)
            for p, (a, b, c) in zip(marker.control_points, places, strict=True)
        )
        return replace(marker, control_points=points)

    return made


def pillars(marker: Marker, fabrication: Fabrication, poses: PoseDistribution | None = None, rim: float = 0.4):
    return pillars_of(marker, dots_of(marker), fabrication, TOOL, plate_of(marker), (), rim, poses)


def looking(*eyes: tuple[float, float, float]) -> PoseDistribution:
    """Poses with the camera at places in mm, turned in whatever way."""
    rotation = np.tile(np.diag([1.0, -1.0, -1.0]), (len(eyes), 1, 1))
    return PoseDistribution("eyes", rotation, -np.einsum("pij,pj->pi", rotation, np.array(eyes) / 1e3))


def test_pillars_are_as_the_design_has_them_and_exactly_as_high(two):
    marker = two(60)
    (pillar,), _ = pillars(marker, Fabrication())
    assert pillar.radius == pytest.approx(1e3 * pillar_radius(0.02, marker.clearance))
    assert max(z for _, z in pillar.body.profile.points) == 20.0
    assert (pillar.foot, pillar.reach) == (1.0, pillar.radius + 1.0)


def test_a_dot_has_a_rim_to_lie_in(two):
    marker = replace(two(60), clearance=0.0004)
    (pillar,), notes = pillars(marker, Fabrication())
    assert pillar.radius == pytest.approx(10.4)
    assert any("0.4 mm wider in radius" in note for note in notes)


def test_feet_are_reduced_where_room_is_short(two):
    # Two pillars of radius 10.5 with 1.4 mm between them: half a millimeter for each and a wall of 0.4 mm.
    results, notes = pillars(two(22.4, flat=20.0), Fabrication())
    assert [pillar.foot for pillar in results] == [0.5, 0.5]
    assert any("0.5 mm or more instead" in note for note in notes)
    # A fillet is no higher than its pillar.
    (low,), _ = pillars(two(60, z=0.5), Fabrication())
    assert low.foot == 0.4
    (lowest,), _ = pillars(two(60, z=0.05), Fabrication())
    assert lowest.foot == 0


def test_pillars_that_would_touch_are_refused(two):
    with pytest.raises(InputError, match=r"dot-0 and the pillar of dot-1, found 0.3 mm; .*--clearance 2.2mm"):
        pillars(two(21.3, flat=20.0), Fabrication())
    square = polygon_from([[[-0.15, -0.15], [0.15, -0.15], [0.15, 0.15], [-0.15, 0.15]]])
    at_edge = replace(two(142), boundary=square)
    with pytest.raises(InputError, match=r"dot-1 and the plate's edge, found 0.5 mm .*--edge"):
        pillars(at_edge, Fabrication())
    with pytest.raises(InputError, match=r"dot-1 and hole M3 at 70 mm, 0 mm, .* by 2.4mm"):
        pillars(replace(two(60), substrate=Substrate(holes=(Hole(0.07, 0.0, 0.003, name="M3"),))), Fabrication())


@pytest.mark.parametrize("marker", [(22.4, 20.0, 20.0), (60.0, 20.0, 20.0)])
def test_the_draft_that_is_named_fits(two, marker):
    with pytest.raises(InputError, match="--draft") as caught:
        pillars(two(*marker), Fabrication(draft=radians(44.9)))
    named = float(caught.value.args[2].split()[2])
    # Both widen by 20 mm times the tangent: what is between them less the wall.
    assert named <= np.degrees(np.arctan((marker[0] - 21.0 - 0.4) / 40))
    assert named == pytest.approx(np.degrees(np.arctan((marker[0] - 21.0 - 0.4) / 40)), abs=0.1)
    pillars(two(*marker), Fabrication(draft=radians(named)))


def blocked(dot: SolidDot, pillar: Pillar, eye: np.ndarray) -> bool:
    """By brute force: whether a line of sight from the dot's rim is within the pillar at some height."""
    angle = 2 * np.pi * np.arange(360) / 360
    rim = np.stack(
        [dot.x + dot.radius * np.cos(angle), dot.y + dot.radius * np.sin(angle), np.full(360, dot.z)], axis=-1
    )
    share = np.linspace(0.0, min(1.0, pillar.dot.z / eye[2]), 201)[1:, None, None]
    places = rim + share * (eye - rim)
    z = places[..., 2]
    inside = z < pillar.dot.z
    axis = np.hypot(places[..., 0] - pillar.dot.x, places[..., 1] - pillar.dot.y)
    wall = pillar.radius + (pillar.dot.z - z) * tan(pillar.draft)
    low = z < pillar.tangent * np.cos(pillar.draft)
    if pillar.foot:
        arc = pillar.reach - np.sqrt(np.maximum(0.0, pillar.foot**2 - (pillar.foot - z) ** 2))
        wall = np.where(low, arc, wall)
    return bool(np.any(inside & (axis < wall - 0.05)))


@pytest.mark.parametrize(("draft", "foot"), [(0.0, 0.0), (0.3, 0.0), (0.0, 8.0), (0.2, 6.0)])
def test_what_pillars_hide_by_brute_force(draft, foot):
    rng = np.random.default_rng(3)
    flat, raised = SolidDot(0, 0.0, 0.0, 0.0, 8.0), SolidDot(1, 36.0, 0.0, 20.0, 8.0)
    pillar = Pillar(raised, 9.0, draft, foot)
    hidden = 0
    for _ in range(80):
        eye = np.array([rng.uniform(50, 400), rng.uniform(-150, 150), rng.uniform(60, 400)])
        result = pillar_hiding_most([flat, raised], [pillar], looking(tuple(eye))) is not None
        brute = blocked(flat, pillar, eye)
        hidden += brute
        # Brute force looks at steps, and 0.05 mm inside of the wall; the chords of a fillet are 0.5 mm off.
        assert result or not brute
        if result != brute:
            slimmer = replace(pillar, radius=pillar.radius - 0.6)
            assert pillar_hiding_most([flat, raised], [slimmer], looking(tuple(eye))) is None
    assert 5 < hidden < 75


def test_a_pillar_that_hides_a_dot_is_refused_or_its_draft_is(two):
    low = looking((400, 0, 150), (-400, 0, 150))
    with pytest.raises(InputError, match=pattern("pillar hides", 1, 0, 2)):
        pillars(two(60), Fabrication(), low)
    # Beside the pillar, low: the wall's draft is in the way.
    beside = looking((127, 54, 47))
    assert len(pillars(two(50), Fabrication(), beside)[0]) == 1
    with pytest.raises(InputError, match=r"dot-0 in 1 of 1 poses; use --draft [\d.]+") as caught:
        pillars(two(50), Fabrication(draft=0.6), beside)
    named = float(caught.value.args[2].split()[2])
    assert 0 < named < np.degrees(0.6)
    pillars(two(50), Fabrication(draft=radians(named)), beside)


def test_feet_hide_nothing_either(two):
    eye = looking((198, 79, 48))
    (free,), _ = pillars(two(50), Fabrication(foot=0.015))
    (seen,), notes = pillars(two(50), Fabrication(foot=0.015), eye)
    assert pillar_hiding_most(dots_of(two(50)), [free], eye)
    assert not pillar_hiding_most(dots_of(two(50)), [seen], eye)
    assert 0 < seen.foot < free.foot == 15
    assert any("instead of 15 mm" in note for note in notes)


def test_poses_come_from_the_spec_of_the_marker(two):
    marker = two(60)
    assert designed_poses(marker) is None
    assert any("not checked" in note for note in PROCESSES["fdm"](marker, Fabrication()).notes)
    designed = replace(
        marker, provenance={"spec": Spec(n=4, poses="cone:distance=0.8..1,tilt=0..20,count=40").as_dict()}
    )
    results = designed_poses(designed)
    assert results is not None
    assert 0 < len(results) <= 40
    assert not PROCESSES["fdm"](designed, Fabrication()).notes
    grazing = replace(
        marker, provenance={"spec": Spec(n=4, poses="cone:distance=0.8..1,tilt=70..75,count=40").as_dict()}
    )
    with pytest.raises(InputError, match="hide no dot"):
        PROCESSES["fdm"](grazing, Fabrication())


def test_balls_that_cover_each_other_are_counted():
    dots = [SolidDot(0, 0, 0, 0, 10.0), SolidDot(1, 40, 0, 0, 10.0)]
    assert balls_hide(dots, looking((20, 0, 500), (500, 0, 10), (0, 500, 10))) == 1
