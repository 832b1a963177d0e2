from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, example, given, settings
from hypothesis import strategies as st

from markergen.model.boundary import Circle
from markergen.model.camera import PAPER_CAMERA
from markergen.model.marker import build_marker
from markergen.model.occlusion import eyes_of, hidden, passage, pillar_radius, sight_gaps
from markergen.model.poses import paper
from markergen.render.patches import project_patches
from markergen.render.view import INK, marker_patches

SHARES, RIM = 150, 240


def inside(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


POINT = st.tuples(inside(-0.1, 0.1), inside(-0.1, 0.1), inside(0, 0.05))
EYE = st.tuples(inside(-1.5, 1.5), inside(-1.5, 1.5), inside(0.06, 1.5))


def by_rays(dot, radius, pillar, wall, eye):
    """Least distance of sampled rays, where lower than the pillar, from its wall; and how coarse the samples are."""
    angle = 2 * np.pi * np.arange(RIM) / RIM
    rim = dot + radius * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    top = np.clip((pillar[2] - dot[2]) / (eye[2] - dot[2]), 0, 1)
    along = top * np.linspace(0, 1, SHARES)[:, None, None]
    ray = rim + along * (eye - rim)
    assert np.all(ray[..., 2] <= pillar[2] + 1e-12)
    coarse = top * np.linalg.norm(eye - dot) / SHARES / 2 + radius * np.pi / RIM
    return np.linalg.norm(ray[..., :2] - pillar[:2], axis=-1).min() - wall, coarse


@given(
    dot=POINT,
    away=st.tuples(inside(1e-6, 0.1), inside(0, 2 * np.pi), inside(1e-4, 0.05)),
    eye=EYE,
    radius=inside(0.001, 0.03),
    rim=inside(0, 0.005),
)
def test_the_closed_form_is_what_rays_find(dot, away, eye, radius, rim):
    dot, eye, wall = np.array(dot), np.array(eye), radius + rim
    gap, angle, rise = away
    aside = radius + wall + gap
    pillar = dot + [aside * np.cos(angle), aside * np.sin(angle), rise]
    gap = passage(dot, np.float64(radius), pillar, np.float64(wall), eye).gap
    result, coarse = by_rays(dot, radius, pillar, wall, eye)
    if gap > -wall:
        # Samples miss the nearest point, and never find a nearer one.
        assert gap - 1e-12 <= result <= gap + coarse
    else:
        # The axis stands among the rays: how deep is not for the rim's rays to tell.
        assert result <= coarse - wall + radius


@settings(max_examples=30)
# The last dot stands between the camera and the first, or does not quite.
@example(turn=0.0, heights=[0.0, 0.0, 0.0, 0.05], distance=0.06, polar=70.0, azimuth=0.0)
@example(turn=0.0, heights=[0.0, 0.0, 0.0, 0.05], distance=0.06, polar=70.0, azimuth=3.0)
@given(
    turn=inside(0, 2 * np.pi),
    heights=st.tuples(inside(0, 0.03), inside(0, 0.03), inside(0, 0.03), inside(0.02, 0.05)),
    distance=inside(0.04, 0.09),
    polar=st.sampled_from([17.5, 52.5, 70.0, 70.0]),
    azimuth=inside(0, 2 * np.pi),
)
def test_what_is_hidden_is_covered_where_it_is_rendered(turn, heights, distance, polar, azimuth):
    import shapely

    corners = distance * np.array([[np.cos(a), np.sin(a)] for a in turn + np.array([0, 2, 4])])
    points = np.column_stack([np.concatenate([corners, np.zeros((1, 2))]), heights])
    marker = build_marker(points, Circle(0.15), 0.03, 0.003)
    gaps = np.linalg.norm(points[:, None, :2] - points[None, :, :2], axis=-1) + np.eye(4)
    assume(gaps.min() > 0.034)
    poses = _pose(polar, azimuth)
    eye = eyes_of(poses)[0]
    assert eye[2] > 0.06
    patches = marker_patches(marker, eye=eye)
    images = project_patches(patches, PAPER_CAMERA, poses.rotation[0], poses.translation[0])
    shapes = [shapely.union_all([shapely.Polygon(o).buffer(0) for o in outlines]) for outlines in images]
    covered = np.zeros(4, dtype=bool)
    for index, patch in enumerate(patches):
        if patch.reflectance != INK:
            continue
        # Its outer circle names the dot.
        center = max(patch.outlines, key=lambda outline: np.ptp(outline[:, 0])).mean(axis=0)
        dot = int(np.argmin(np.linalg.norm(points - center, axis=-1)))
        face = shapely.Polygon(max(images[index], key=lambda outline: np.ptp(outline[:, 0])))
        covered[dot] = face.intersection(shapely.union_all(shapes[index + 1 :])).area > 1e-3
    radius = pillar_radius(0.03, 0.003)
    nearest = sight_gaps(points, np.float64(0.015), np.float64(radius), eye[None])[0].min(axis=-1)
    # A few um of overlap is too little of a pixel to be told from the roundness of the polygons.
    output = np.abs(nearest) > 2e-5
    event("hidden" if covered.any() else "in sight")
    np.testing.assert_array_equal(covered[output], (nearest < 0)[output])
    np.testing.assert_array_equal(hidden(marker, poses)[0], nearest < -1e-9)


def _pose(polar, azimuth):
    """One pose as the paper's are, at the nearest of its polar angles in deg, 0.7 m away."""
    from markergen.maths.rotation import rotation_z

    poses = paper()
    taken = poses.taken(np.array([np.argmin(np.abs(poses.polar_angle_deg - polar))]), 0)
    away = np.array([[0, 0, 0.7]])
    return replace(taken, rotation=taken.rotation @ rotation_z(np.array([azimuth])), translation=away)


@given(
    points=st.lists(POINT, min_size=3, max_size=5),
    eye=EYE,
    share=inside(0, 1),
)
def test_lower_pillars_hide_less(points, eye, share):
    points, eye = np.array(points), np.array([eye])
    radii = np.float64(0.01), np.float64(0.011)
    high = sight_gaps(points, *radii, eye)
    low = sight_gaps(points * [1, 1, share], *radii, eye)
    assert np.all(low >= high - 1e-12)


def test_a_shadow_by_hand():
    # From 45 degrees a pillar of 40 mm hides the plate up to 40 mm behind it.
    points = np.array([[0.0, 0.0, 0.04], [-0.055, 0.0, 0.0]])
    eye = np.array([[1.0, 0.0, 1.0]])
    line = sight_gaps(points, np.float64(0.0), np.float64(0.01), eye)
    # The ray from (-55, 0) is 40 mm high at (-15, 0) after 40/1000 of its way of 1055 mm.
    assert line[0, 1, 0] == pytest.approx(0.055 - 0.04 * 1.055 - 0.01, abs=1e-15)
    # The nearest ray to a dot of 10 mm radius comes from its near edge, which is as much lower at (-5, 0).
    disk = sight_gaps(points, np.float64(0.01), np.float64(0.01), eye)
    assert disk[0, 1, 0] == pytest.approx(0.055 - 0.04 * 1.055 - 0.96 * 0.01 - 0.01, abs=1e-15)


def test_what_is_not_higher_hides_nothing():
    points = np.array([[0.0, 0.0, 0.02], [0.05, 0.0, 0.02], [-0.05, 0.0, 0.0]])
    gaps = sight_gaps(points, np.float64(0.01), np.float64(0.011), np.array([[0.3, 0.1, 0.5], [0.0, 0.0, 1.0]]))
    assert np.all(np.isinf(gaps[:, :2]))
    assert np.all(np.isinf(gaps[:, 2, 2]))
    assert np.all(np.isfinite(gaps[:, 2, :2]))
    # From 1 m over the middle dot, a fiftieth of the way up, a fiftieth of the way has gone by.
    assert gaps[1, 2, 0] == pytest.approx(0.98 * (0.05 - 0.01) - 0.011, abs=1e-15)


def test_an_eye_below_sees_no_face():
    points = np.array([[0.0, 0.0, 0.02], [0.05, 0.0, 0.0]])
    gaps = sight_gaps(points, np.float64(0.01), np.float64(0.011), np.array([[0.3, 0.1, 0.02], [0.3, 0.1, 0.01]]))
    assert np.all(gaps[:, 0] == -np.inf)
    assert np.all(gaps[:, 1] > -np.inf)


def test_bare_points_have_no_pillars():
    assert pillar_radius(0.0, 0.003) == 0
    assert pillar_radius(0.03, 0.004) == pytest.approx(0.016)
    points = np.array([[0.0, 0.0, 0.05], [-0.01, 0.0, 0.0], [0.1, 0, 0], [0, 0.1, 0]])
    marker = build_marker(points, Circle(0.15), 0.0, 0.0)
    assert not hidden(marker, paper()).any()
    assert hidden(build_marker(points, Circle(0.15), 0.008, 0.0), paper()).any()
