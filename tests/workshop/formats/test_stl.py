import numpy as np
import pytest
from tetrahedra import SIDES, part

from markergen.workshop.formats.meshes import write_stl
from markergen.workshop.mesh import FACET

CORNERS = np.array([[0, 0, 0], [4, 0, 0], [0, 4, 0], [0, 0, 4]], float)


def facets(data: bytes) -> np.ndarray:
    return np.frombuffer(data, FACET, offset=84)


def test_is_binary_counts_its_triangles_and_names_the_marker():
    data = write_stl([part("plate", "light", CORNERS)], "markergen-12ab")
    assert data[:80].rstrip().startswith(b"markergen-12ab, markergen ")
    assert int.from_bytes(data[80:84], "little") == 4
    assert len(data) == 84 + 4 * 50


def test_corners_are_millimeters_and_normals_point_outside():
    results = facets(write_stl([part("plate", "light", CORNERS)], "m"))
    np.testing.assert_array_equal(results["corners"], CORNERS[SIDES])
    third = 3**-0.5
    expected = [[0, 0, -1], [0, -1, 0], [third, third, third], [-1, 0, 0]]
    np.testing.assert_allclose(results["normal"], expected, atol=1e-7)  # 32-bit floats
    assert not results["attribute"].any()


def test_a_triangle_without_an_area_has_no_normal():
    results = facets(
        write_stl([part("plate", "light", np.array([[0, 0, 1.0], [1, 0, 1], [2, 0, 1]]), np.array([[0, 1, 2]]))], "m")
    )
    np.testing.assert_array_equal(results["normal"], [[0, 0, 0]])


def test_equal_points_of_two_parts_are_kept_apart_by_less_than_a_micrometer():
    data = write_stl([part("plate", "light", CORNERS), part("dot-0", "dark", CORNERS)], "m")
    first, second = facets(data)["corners"].reshape(2, -1, 3)
    moved = np.linalg.norm(first - second, axis=-1)
    assert moved.min() > 0
    assert moved.max() < 1e-3


@pytest.mark.parametrize("material", ["light", "dark"])
def test_one_part_stays_where_it_is(material):
    np.testing.assert_array_equal(facets(write_stl([part("p", material, CORNERS)], "m"))["corners"], CORNERS[SIDES])
