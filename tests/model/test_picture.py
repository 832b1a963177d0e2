import numpy as np
import pytest
import rigs

from markergen.geometry.region import signed_area
from markergen.model.boundary import Circle, polygon_from
from markergen.model.picture import draw_marker, draw_rig, shows_origin, sides


def drawn(marker):
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch

    ax = draw_marker(marker, Figure().subplots())
    return ax, [patch for patch in ax.patches if isinstance(patch, PathPatch)]


def test_outlines_are_to_scale_and_holes_are_open(shape, make_in):
    marker = make_in(shape, 5, 0.01)
    ax, (plate,) = drawn(marker)
    path = plate.get_path()
    corners = 1e3 * np.concatenate(shape.outlines())
    np.testing.assert_allclose(path.get_extents().bounds[:2], corners.min(axis=0), atol=1e-9)
    np.testing.assert_allclose(path.get_extents().bounds[2:], np.ptp(corners, axis=0), atol=1e-9)
    # Nonzero winding: holes are open because they run the other way round.
    areas = [signed_area(polygon[:-1]) for polygon in path.to_polygons()]
    assert sum(areas) == pytest.approx(1e6 * shape.area, rel=1e-9)
    printed = [*ax.get_xlim(), *ax.get_ylim()]
    assert printed[0] < corners[:, 0].min() < corners[:, 0].max() < printed[1]
    assert printed[2] < corners[:, 1].min() < corners[:, 1].max() < printed[3]


@pytest.mark.parametrize(("name", "phrase"), [("rectangle", "200 mm wide, 100 mm high"), ("L", "200 mm")])
def test_the_size_is_written_down(shapes, make_in, name, phrase):
    ax, _ = drawn(make_in(shapes[name], 5, 0.01))
    assert phrase in [text.get_text() for text in ax.texts]


def test_keep_outs_are_cut_off_at_the_boundary(shapes, make_in):
    ax, (plate, *keep_outs) = drawn(make_in(shapes["rectangle"], 5, 0.01, (Circle(0.02, (0.1, 0.0)), Circle(0.01))))
    assert len(keep_outs) == 2
    for patch in keep_outs:
        clip, transform = patch.get_transformed_clip_path_and_affine()
        np.testing.assert_allclose(clip.vertices, plate.get_path().vertices, atol=1e-9)
        np.testing.assert_allclose(transform.get_matrix(), ax.transData.get_matrix())


def test_axes_are_drawn_where_the_origin_is_in_the_picture(make_in):
    for offset, printed in ((0.0, True), (-0.05, True), (0.7, False)):
        marker = make_in(
            polygon_from([offset + np.array([[0, 0], [0.12, 0], [0.1, 0.08], [0, 0.08]])], "file"), 5, 0.01
        )
        assert shows_origin(marker) is printed
        assert ("x" in [text.get_text() for text in drawn(marker)[0].texts]) is printed


def test_a_rig_shows_the_plates_that_face_the_front():
    """Of a cube three, each with its name; its plot is the picture of the front."""
    cube = rigs.cube()
    plates = {plate.name for plate in cube.plates}
    front, back = cube.plot(), draw_rig(cube, direction=-np.array(sides(cube)["front"]))
    printed = [{text.get_text() for text in ax.texts} & plates for ax in (front, back)]
    assert [len(names) for names in printed] == [3, 3]
    assert not printed[0] & printed[1]
