"""The bundle for apriltag_ros, held against AprilTag's own library on rendered sheets."""

import ctypes
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from pupil_apriltags import Detector
from renderers import MM, by_pdfium, centers
from scipy.spatial.transform import Rotation

from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import pages_for
from markergen.exporters import EXPORTERS, ExportOptions
from markergen.exporters.formats.points import write_bundle, write_kalibr, write_ros2
from markergen.exporters.formats.sheets import write_pdf
from markergen.maths.information import covariance, information, pose_jacobian
from markergen.maths.rotation import angle_between, rigid_motion
from markergen.model.tag import FAMILIES, Tag, tag_ink

NAMES = [family.removeprefix("apriltag:") for family in FAMILIES if family.startswith("apriltag:")]

# The first codes of tag36h10.c in AprilTag 3. The wheel lacks that family, whose cells have the order of 36h11.
CODES_36H10 = (0x1A42F9469, 0x21A48C08D, 0x26DFDBC5D, 0x2D19B78FB)

FOCAL, WIDTH, HEIGHT = 1400.0, 1280, 960
PRINCIPAL = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
CORNER_PX = 0.1
"""Error of AprilTag's corners, px per axis: 0.08 RMS here; pixels counted from their middles would give 0.5."""


def detector(name: str):
    """Detector of one family, and the family itself."""
    made = Detector(families="tag36h11" if name == "36h10" else f"tag{name}", quad_decimate=1.0)
    (family,) = made.tag_families.values()
    if name == "36h10":
        made.libc.apriltag_detector_clear_families(made.tag_detector_ptr)
        made.codes = (ctypes.c_uint64 * len(CODES_36H10))(*CODES_36H10)
        family.contents.codes, family.contents.ncodes, family.contents.h = made.codes, len(CODES_36H10), 10
        made.libc.apriltag_detector_add_family_bits(made.tag_detector_ptr, family, 2)
    # Its destructor frees the families, and after that writes into them: without any it spoils nothing.
    made.tag_families.clear()
    return made, family.contents


def marker_with(make_ngon, name: str):
    return replace(make_ngon(5, 0.045, 0.01), tag=Tag(f"apriltag:{name}", 3, 0.03, (0.004, -0.002)))


def pose():
    """R and t of a view tilted by 35 degrees, rolled, and off the middle."""
    facing = np.diag([1.0, -1.0, -1.0])
    return Rotation.from_euler("zyx", [25, 20, 30], degrees=True).as_matrix() @ facing, np.array([0.012, -0.008, 0.28])


def matrix(x: float, y: float) -> np.ndarray:
    return np.array([[FOCAL, 0, x], [0, FOCAL, y], [0, 0, 1]])


def photograph(marker, folder) -> np.ndarray:
    """The sheet as pdfium draws it, seen from `pose`; where the marker is on the page its drawn dots say."""
    sheet = pages_for([marker], SheetOptions(paper="A5"))[0]
    (folder / "sheet.pdf").write_bytes(write_pdf([sheet]))
    page = by_pdfium(folder)
    dots = centers(page, sheet) / 1e3
    R, offset = rigid_motion(dots, marker.xyz[:, :2])
    assert np.abs(dots @ R.T + offset - marker.xyz[:, :2]).max() < 2e-5
    on_page = np.array([[MM, 0, MM / 2], [0, -MM, sheet.paper.height - MM / 2], [0, 0, 1e3]]) / 1e3
    to_marker = np.vstack([np.column_stack([R, offset]), [0, 0, 1]])
    rotation, translation = pose()
    view = matrix(*PRINCIPAL) @ np.column_stack([rotation[:, :2], translation]) @ to_marker @ on_page
    # About two pixels of the page to one of the view.
    smooth = cv2.GaussianBlur(page, (0, 0), 1.0)
    return cv2.warpPerspective(smooth, view, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderValue=255)


def bundle(marker) -> tuple[float, np.ndarray, np.ndarray]:
    """Size, rotation and place of the tag in the bundle, as apriltag_ros reads them."""
    (tag,) = yaml.safe_load(write_bundle(marker))["tag_bundles"][0]["layout"]
    rotation = Rotation.from_quat([tag[key] for key in ("qx", "qy", "qz", "qw")]).as_matrix()
    return tag["size"], rotation, np.array([tag[key] for key in "xyz"])


@pytest.mark.parametrize("name", [NAMES[0], *(pytest.param(name, marks=pytest.mark.long) for name in NAMES[1:])])
def test_poses_by_apriltag_are_those_of_the_marker_frame(name, make_ngon, tmp_path):
    marker = marker_with(make_ngon, name)
    size, R, place = bundle(marker)
    # AprilTag counts pixels from the corner of the first, we from its middle.
    camera = (FOCAL, FOCAL, PRINCIPAL[0] + 0.5, PRINCIPAL[1] + 0.5)
    (finding,) = detector(name)[0].detect(photograph(marker, tmp_path), True, camera, size)
    assert finding.tag_id == marker.tag.id
    # AprilTag's tag has y down and z into the paper, apriltag_ros's y up and z toward the viewer.
    seen, at = finding.pose_R @ np.diag([1, -1, -1]), finding.pose_t.ravel()
    rotation = seen @ R.T
    translation = at - rotation @ place
    true_rotation, true_translation = pose()
    corners = np.pad(marker.tag.corners, ((0, 0), (0, 1)))
    jacobian = pose_jacobian(corners, true_rotation[None], true_translation[None], np.array([FOCAL, FOCAL]))[0]
    spread = CORNER_PX**2 * covariance(information(jacobian))
    # Three standard deviations: 0.4 degrees, and 0.6 mm, nearly all of it along the line of sight.
    assert angle_between(rotation, true_rotation) < 3 * np.sqrt(np.trace(spread[:3, :3]))
    assert np.linalg.norm(translation - true_translation) < 3 * np.sqrt(np.trace(spread[3:, 3:]))
    # Its corners count from its own lower left one, counterclockwise: our top right, top left, and so on.
    pixels = (corners @ true_rotation.T + true_translation) @ matrix(*camera[2:]).T
    off = finding.corners - (pixels[:, :2] / pixels[:, 2:])[[1, 0, 3, 2]]
    assert np.abs(off).max() < 3 * CORNER_PX
    assert np.abs(off.mean(axis=0)).max() < 1.5 * CORNER_PX


@pytest.mark.parametrize("name", NAMES)
def test_every_tag_is_the_official_one_turned_by_half_a_turn(name):
    _, family = detector(name)
    for number in range(family.ncodes):
        ink = np.ones((family.width_at_border,) * 2, dtype=bool)
        for k in range(family.nbits):
            if family.codes[number] >> (family.nbits - 1 - k) & 1:
                ink[family.bit_y[k], family.bit_x[k]] = False
        np.testing.assert_array_equal(tag_ink(f"apriltag:{name}", number), np.rot90(ink, 2))


@pytest.mark.parametrize("write", [write_ros2, write_kalibr])
def test_lists_say_that_apriltag_sees_it_upside_down(write, make_ngon):
    marker = marker_with(make_ngon, "36h11")
    assert "turned by 180 degrees" in write(marker)
    assert "180 degrees" not in write(replace(marker, tag=Tag("aruco:DICT_4X4_50", 3, 0.03)))


def test_a_family_that_apriltag_ros_lacks_is_told(make_ngon):
    message = {
        name: EXPORTERS[".apriltag.yaml"]([marker_with(make_ngon, name)], ExportOptions()).notes for name in NAMES
    }
    assert [name for name in NAMES if message[name]] == ["36h10"]
    assert "apriltag_ros does not" in message["36h10"][0]
    assert message["36h10"][0] in write_bundle(marker_with(make_ngon, "36h10"))


def test_the_size_is_that_of_the_print(make_ngon):
    """1 % too large along x, 3 % along y."""
    size, _, place = bundle(replace(marker_with(make_ngon, "36h11"), print_scale=(1.01, 1.03)))
    assert size == pytest.approx(0.03 * np.sqrt(1.01 * 1.03), abs=1e-12)
    np.testing.assert_allclose(place, [0.00404, -0.00206, 0], atol=1e-12)
