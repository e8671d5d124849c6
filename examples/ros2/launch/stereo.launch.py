"""One stereo camera: `ros2 launch stream_sfm_ros stereo.launch.py camera:=/my_camera base_frame:=base_link`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

_ARGUMENTS = {
    "camera": ("/camera", "the namespace of left/image_raw, right/image_raw and their camera_info"),
    "calibration": ("", "a calibration file instead of the camera infos"),
    "config": ("", "settings of stream_sfm, a TOML file"),
    "image_transport": ("raw", "raw, or compressed for left/image_raw/compressed"),
    "rectified": ("false", "whether the images are rectified"),
    "base_frame": ("", "the frame of the robot, such as base_link"),
}


def generate_launch_description() -> LaunchDescription:
    """The node in the namespace of its camera."""
    given = {name: LaunchConfiguration(name) for name in _ARGUMENTS}
    node = Node(
        package="stream_sfm_ros",
        executable="odometry",
        namespace=given["camera"],
        parameters=[
            {name: given[name] for name in ("calibration", "config", "image_transport", "rectified")},
            {"settings": [["ros.base_frame=", given["base_frame"]]]},
        ],
    )
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in _ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, node])
