"""Points: the marker itself, tables, and configurations of what detects it."""

from markergen.exporters import EXPORTERS, Exporter

EXPORTERS.register(".json")(Exporter("markergen.exporters.marker_json:export", "the marker itself"))
EXPORTERS.register(".csv")(Exporter("markergen.exporters.point_table:export", "table of the dots, in m"))
EXPORTERS.register(".opencv.yaml")(
    Exporter("markergen.exporters.opencv:export", "OpenCV: object points and ids, tag as an ArUco board")
)
EXPORTERS.register(".ros2.yaml")(Exporter("markergen.exporters.ros2:export", "ROS 2: static transform and landmarks"))
EXPORTERS.register(".kalibr.yaml")(Exporter("markergen.exporters.kalibr:export", "target in the style of Kalibr"))
EXPORTERS.register(".apriltag.yaml")(
    Exporter("markergen.exporters.apriltag:export", "apriltag_ros: bundle of an AprilTag")
)
