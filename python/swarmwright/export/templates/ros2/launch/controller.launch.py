# @mark@; changes here are lost.
"""ros2 launch @package@ controller.launch.py mapping:=mapping.yaml [robot:=robot_1] [node:=python]"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "mapping",
                description="YAML file with topics of sensors and actuators, made from config/mapping.template.yaml",
            ),
            DeclareLaunchArgument(
                "robot",
                default_value="",
                description="Namespace of the robot, in which relative names of topics are",
            ),
            DeclareLaunchArgument(
                "node",
                default_value="cpp",
                choices=["cpp", "python"],
                description="Which of the two nodes: with rclcpp or with rclpy",
            ),
            DeclareLaunchArgument(
                "use_sim_time",
                default_value="false",
                choices=["true", "false"],
                description="Take the time from /clock",
            ),
            Node(
                package="@package@",
                executable=["swarmwright_controller_", LaunchConfiguration("node")],
                name="swarmwright_controller",
                namespace=LaunchConfiguration("robot"),
                output="screen",
                parameters=[
                    {
                        "mapping": ParameterValue(LaunchConfiguration("mapping"), value_type=str),
                        "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool),
                    }
                ],
            ),
        ]
    )
