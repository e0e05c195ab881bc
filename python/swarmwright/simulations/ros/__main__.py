"""Drives robots of a ROS system stepwise: `python3 THIS_FOLDER ATTACHMENT.json`.

Python 3.8 or later can run it with only this folder.
"""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

NAME = "swarmwright_ros"
"""What this folder is imported as: Swarmwright itself may not be there."""


def main() -> int:
    """Run the program; return its exit status."""
    folder = Path(__file__).resolve().parent
    sys.path[:] = [entry for entry in sys.path if Path(entry or ".").resolve() != folder]
    spec = importlib.util.spec_from_file_location(
        NAME, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    package = importlib.util.module_from_spec(spec)
    sys.modules[NAME] = package
    spec.loader.exec_module(package)
    attaching = importlib.import_module(f"{NAME}.attaching")
    status: int = attaching.main(sys.argv[1:])
    return status


if __name__ == "__main__":
    sys.exit(main())
