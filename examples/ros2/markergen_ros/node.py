"""ros2 run markergen_ros detect --ros-args -p markers:=dock=marker.json -r image:=/camera/image_raw"""

from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from markergen_detect import Camera, DescriptionError, Detector, Finding
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from tf2_ros import TransformBroadcaster
from visualization_msgs.msg import Marker

from markergen_ros.images import array_of, camera_of, grey
from markergen_ros.poses import dots_of, pose_of, transform_of


class MarkerNode(Node):
    def __init__(self) -> None:
        super().__init__("markergen")
        texts = self.declare_parameter("markers", "marker.json").value.split(",")
        self.paths = [text.rpartition("=")[2] for text in texts]
        self.frames = [text.rpartition("=")[0] or Path(text).stem for text in texts]
        self.sigma = self.declare_parameter("print_sigma", 0.0).value or None
        self.poses = [self.create_publisher(PoseWithCovarianceStamped, f"~/{frame}/pose", 10) for frame in self.frames]
        self.dots = self.create_publisher(Marker, "~/dots", 10)
        self.tf = TransformBroadcaster(self)
        self.camera: Camera | None = None
        self.before: list[Finding] = []
        self.create_subscription(CameraInfo, "camera_info", self.guarded(self.calibrate), qos_profile_sensor_data)
        self.create_subscription(Image, "image", self.guarded(self.detect), qos_profile_sensor_data)

    def guarded(self, callback: Any) -> Any:
        def call(message: Any) -> None:
            try:
                callback(message)
            except DescriptionError as error:
                self.get_logger().error(str(error), throttle_duration_sec=5.0)

        return call

    def calibrate(self, message: CameraInfo) -> None:
        camera = camera_of(message)
        if camera != self.camera:
            self.camera, self.before = None, []
            self.detector = Detector(self.paths, camera, print_sigma=self.sigma, copies=1)
            self.camera = camera

    def detect(self, message: Image) -> None:
        if self.camera is None:
            return
        self.before = self.detector(grey(array_of(message)), near=self.before)
        for finding in self.before:
            if finding.ok:
                frame = self.frames[finding.body]
                pose = pose_of(finding, message.header)
                self.poses[finding.body].publish(pose)
                self.tf.sendTransform(transform_of(pose, frame))
                self.dots.publish(dots_of(finding, self.detector.bodies[finding.body], pose, frame))


def main() -> None:
    rclpy.init()
    try:
        rclpy.spin(MarkerNode())
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()
