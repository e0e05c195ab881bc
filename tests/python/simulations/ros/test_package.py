"""The modules can be run by the Python that ROS was installed for, without Swarmwright."""

import ast
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[4] / "python" / "swarmwright" / "simulations" / "ros"
MODULES = sorted(FOLDER.glob("*.py"))
MIDDLEWARE = {
    "attaching": {"rclpy"},
    "dds": {"cyclonedds"},
    "rclpy_middleware": {"rclpy"},
    "rospy_middleware": {"rosgraph", "roslib", "rospy"},
}
OTHERS = {"control": {"yaml"}}


@pytest.mark.parametrize("module", MODULES, ids=lambda module: module.stem)
def test_a_module_needs_nothing_else_and_an_old_python(module: Path) -> None:
    tree = ast.parse(module.read_text(encoding="utf-8"), feature_version=(3, 8))
    allowed = {*sys.stdlib_module_names, *MIDDLEWARE.get(module.stem, ()), *OTHERS.get(module.stem, ())}
    names = {one.stem for one in MODULES}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            assert {one.name.split(".")[0] for one in node.names} <= allowed
        elif isinstance(node, ast.ImportFrom) and node.level:
            assert node.level == 1
            assert node.module in names
        elif isinstance(node, ast.ImportFrom):
            assert node.module is not None
            assert node.module.split(".")[0] in allowed
    if len(tree.body) > 1:
        assert "from __future__ import annotations" in module.read_text(encoding="utf-8")
