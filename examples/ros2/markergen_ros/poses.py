"""From a finding to messages of ROS, in the optical frame of the camera (REP 103), which is OpenCV's."""

from typing import Any

import numpy as np
from geometry_msgs.msg import Point, PoseWithCovarianceStamped, TransformStamped
from markergen_detect import Body, Finding
from visualization_msgs.msg import Marker

XYZ_FIRST = [3, 4, 5, 0, 1, 2]
"""ROS has the translation first; both turn about the fixed axes of the camera."""


def quaternion_of(rotation: Any) -> list[float]:
    """Return x, y, z, w of a rotation: the eigenvector of the largest eigenvalue (I. Bar-Itzhack, 2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    matrix = [
        [xx - yy - zz, xy + yx, xz + zx, zy - yz],
        [xy + yx, yy - xx - zz, yz + zy, xz - zx],
        [xz + zx, yz + zy, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ]
    return list(map(float, np.linalg.eigh(matrix)[1][:, 3]))


def pose_of(finding: Finding, header: Any) -> PoseWithCovarianceStamped:
    assert finding.translation is not None  # with a camera there is a pose
    assert finding.covariance is not None
    message = PoseWithCovarianceStamped(header=header)
    pose = message.pose.pose
    pose.position.x, pose.position.y, pose.position.z = map(float, finding.translation)
    rotation = pose.orientation
    rotation.x, rotation.y, rotation.z, rotation.w = quaternion_of(finding.rotation)
    message.pose.covariance = finding.covariance[XYZ_FIRST][:, XYZ_FIRST].ravel().tolist()
    return message


def transform_of(pose: PoseWithCovarianceStamped, frame: str) -> TransformStamped:
    message = TransformStamped(header=pose.header, child_frame_id=frame)
    at, message.transform.rotation = pose.pose.pose.position, pose.pose.pose.orientation
    to = message.transform.translation
    to.x, to.y, to.z = at.x, at.y, at.z
    return message


def dots_of(finding: Finding, body: Body, pose: PoseWithCovarianceStamped, frame: str) -> Marker:
    message = Marker(header=pose.header, ns=frame, type=Marker.SPHERE_LIST, pose=pose.pose.pose)
    message.scale.x = message.scale.y = message.scale.z = float(body.diameters.mean())
    message.color.g = message.color.a = 1.0
    message.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in body.xyz[np.isin(body.ids, finding.ids)]]
    return message
