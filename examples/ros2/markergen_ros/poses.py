"""From a detection to messages of ROS, in the optical frame of the camera (REP 103), which is OpenCV's."""

from typing import Any

from geometry_msgs.msg import Point, PoseWithCovarianceStamped, TransformStamped
from scipy.spatial.transform import Rotation
from visualization_msgs.msg import Marker

from markergen import Found, Rig

XYZ_FIRST = [3, 4, 5, 0, 1, 2]
"""ROS has the translation first; both turn about the fixed axes of the camera."""


def pose_of(found: Found, header: Any) -> PoseWithCovarianceStamped:
    assert found.translation is not None  # with a camera there is a pose
    assert found.covariance is not None
    message = PoseWithCovarianceStamped(header=header)
    pose = message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = map(float, found.translation)
    turn = Rotation.from_matrix(found.rotation).as_quat()
    pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w = map(float, turn)
    message.pose.covariance = found.covariance[XYZ_FIRST][:, XYZ_FIRST].ravel().tolist()
    return message


def transform_of(pose: PoseWithCovarianceStamped, frame: str) -> TransformStamped:
    message = TransformStamped(header=pose.header, child_frame_id=frame)
    at, message.transform.rotation = pose.pose.pose.position, pose.pose.pose.orientation
    to = message.transform.translation
    to.x, to.y, to.z = at.x, at.y, at.z
    return message


def dots_of(found: Found, pose: PoseWithCovarianceStamped, frame: str) -> Marker:
    marker = found.marker
    size = float(2 * marker.radii.mean()) if isinstance(marker, Rig) else marker.dot_diameter
    message = Marker(header=pose.header, ns=frame, type=Marker.SPHERE_LIST, pose=pose.pose.pose)
    message.scale.x = message.scale.y = message.scale.z = size
    message.color.g = message.color.a = 1.0
    message.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in found.xyz]
    return message
