# @mark@; changes here are lost.
"""The node without ROS 2, beside any ROS 2 system: `pip install 'cyclonedds>=11,<12' pyyaml`, Python 3.10 or later.

python3 -m @package@.dds_node --mapping mapping.yaml --robot robot_1
"""

import argparse
import sys

from .exported import ACTUATORS, SENSORS, Controller


def main() -> int:
    """Run until SIGINT or SIGTERM; return the exit status, 2 for a mistake in the mapping."""
    parser = argparse.ArgumentParser(
        prog="python3 -m @package@.dds_node",
        description="Runs an evolved controller on a robot with ROS 2, without ROS 2.",
    )
    parser.add_argument(
        "--mapping",
        required=True,
        metavar="FILE",
        help="YAML file with topics of sensors and actuators, made from config/mapping.template.yaml",
    )
    parser.add_argument(
        "--robot",
        default="/",
        metavar="NAMESPACE",
        help="of the robot, in which relative names of topics are. Default: /",
    )
    parser.add_argument(
        "--domain", type=int, metavar="N", help="of DDS. Default: that of ROS_DOMAIN_ID, else 0"
    )
    parser.add_argument("--use-sim-time", action="store_true", help="take the time from /clock")
    given = parser.parse_args()
    try:
        import yaml  # noqa: F401

        from .dds import Dds
    except ModuleNotFoundError as error:
        print(f"{parser.prog}: needs {error.name}: pip install 'cyclonedds>=11,<12' pyyaml", file=sys.stderr)
        return 2
    from .control import NAME, drive
    from .middleware import MiddlewareError

    try:
        node = Dds(NAME, given.robot, domain=given.domain, use_sim_time=given.use_sim_time)
    except MiddlewareError as error:
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return 2
    return drive(node, given.mapping, Controller(), SENSORS, ACTUATORS)


if __name__ == "__main__":
    sys.exit(main())
