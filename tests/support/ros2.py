"""Stand-ins for rclpy and the messages of ROS 2, with as much as the example's node needs of them."""

import sys
from types import MappingProxyType, ModuleType, SimpleNamespace

FIELDS = {
    "Point": {"x": 0.0, "y": 0.0, "z": 0.0},
    "Vector3": {"x": 0.0, "y": 0.0, "z": 0.0},
    "Quaternion": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
    "ColorRGBA": {"r": 0.0, "g": 0.0, "b": 0.0, "a": 0.0},
    "Header": {"stamp": None, "frame_id": ""},
    "Pose": {"position": "Point", "orientation": "Quaternion"},
    "PoseWithCovariance": {"pose": "Pose", "covariance": ()},
    "PoseWithCovarianceStamped": {"header": "Header", "pose": "PoseWithCovariance"},
    "Transform": {"translation": "Vector3", "rotation": "Quaternion"},
    "TransformStamped": {"header": "Header", "child_frame_id": "", "transform": "Transform"},
    "Marker": {
        "header": "Header", "ns": "", "type": 0, "pose": "Pose", "scale": "Vector3", "color": "ColorRGBA", "points": (),
    },
    "Image": {
        "header": "Header", "height": 0, "width": 0, "encoding": "", "is_bigendian": 0, "step": 0, "data": b"",
    },
    "CameraInfo": {
        "header": "Header", "height": 0, "width": 0, "distortion_model": "", "d": (), "k": (), "binning_x": 0,
        "binning_y": 0,
    },
}  # fmt: skip
"""Fields of messages as ROS 2 declares them: other messages by name, or default values."""

PACKAGES = {
    "geometry_msgs.msg": ("Point", "PoseWithCovarianceStamped", "TransformStamped"),
    "sensor_msgs.msg": ("CameraInfo", "Image"),
    "visualization_msgs.msg": ("Marker",),
}


def message(name):
    """Return a class that takes its fields as keywords, and refuses others, as ROS does."""

    class Message(SimpleNamespace):
        def __init__(self, **stated):
            fields = {
                key: message(default)() if isinstance(default, str) and default in FIELDS else default
                for key, default in FIELDS[name].items()
            }
            assert set(stated) <= set(fields)
            super().__init__(**{**fields, **stated})

        def __setattr__(self, key, value):
            assert key in FIELDS[name], f"{name} has no {key}"
            kinds = {float: float, int: int, str: str, tuple: (tuple, list)}
            expected = kinds.get(type(FIELDS[name][key]))
            named = FIELDS[name][key] in FIELDS if isinstance(FIELDS[name][key], str) else False
            assert named or expected is None or isinstance(value, expected), f"{name}.{key} takes no {type(value)}"
            super().__setattr__(key, value)

    Message.__name__ = name
    return Message


class Node:
    """Records what a node declares, publishes and logs; `parameters` are what the command line would set."""

    parameters = MappingProxyType({})

    def __init__(self, name):
        self.name, self.published, self.callbacks, self.errors = name, {}, {}, []

    def declare_parameter(self, name, default):
        value = self.parameters.get(name, default)
        assert type(value) is type(default)
        return SimpleNamespace(value=value)

    def create_publisher(self, kind, topic, depth):
        sent = self.published.setdefault(topic, [])

        def publish(message):
            assert type(message).__name__ == kind.__name__
            sent.append(message)

        return SimpleNamespace(publish=publish)

    def create_subscription(self, kind, topic, callback, quality):
        self.callbacks[topic] = callback

    def get_logger(self):
        return SimpleNamespace(error=lambda text, **often: self.errors.append(text))


class TransformBroadcaster:
    def __init__(self, node):
        self.sent = node.published.setdefault("/tf", [])

    def sendTransform(self, transform):
        self.sent.append(transform)


def put_in_place(monkeypatch):
    """Make ROS importable for one test."""
    modules = {
        "rclpy": {"init": lambda: None, "spin": lambda node: None, "try_shutdown": lambda: None},
        "rclpy.executors": {"ExternalShutdownException": SystemExit},
        "rclpy.node": {"Node": Node},
        "rclpy.qos": {"qos_profile_sensor_data": "sensor data"},
        "tf2_ros": {"TransformBroadcaster": TransformBroadcaster},
        **{name: {item: message(item) for item in messages} for name, messages in PACKAGES.items()},
    }
    modules["visualization_msgs.msg"]["Marker"].SPHERE_LIST = 7
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
        package = name.partition(".")[0]
        if package not in modules:
            monkeypatch.setitem(sys.modules, package, ModuleType(package))
