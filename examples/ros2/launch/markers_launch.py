"""ros2 launch markergen_ros markers_launch.py markers:=dock=/path/marker.json image:=/camera/image_raw"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    topics = {"image": "/camera/image_raw", "camera_info": "/camera/camera_info"}
    markers = ParameterValue(LaunchConfiguration("markers"), value_type=str)
    node = Node(
        package="markergen_ros",
        executable="detect",
        name="markergen",
        output="screen",
        parameters=[{"markers": markers}],
        remappings=[(topic, LaunchConfiguration(topic)) for topic in topics],
    )
    files = DeclareLaunchArgument("markers", description="FRAME=FILE of markers and rigs, separated by commas")
    named = [DeclareLaunchArgument(topic, default_value=default) for topic, default in topics.items()]
    return LaunchDescription([files, *named, node])
