"""Export of controllers as source code and models. `EXPORTERS` has all formats by their names."""

from swarmwright.common.registry import Registry
from swarmwright.export._base import Exporter, Files, NotInstalledError, file_bytes
from swarmwright.export.subject import Subject

__all__ = ["EXPORTERS", "Exporter", "Files", "NotInstalledError", "Subject", "file_bytes"]

EXPORTERS: Registry[Exporter] = Registry(
    "export format",
    "swarmwright.exporters",
    {
        "c": "swarmwright.export.c:C",
        "cpp": "swarmwright.export.cpp:Cpp",
        "fmu": "swarmwright.export.fmu:Fmu",
        "fmu3": "swarmwright.export.fmu:Fmu3",
        "machine": "swarmwright.export.machine:Machine",
        "micropython": "swarmwright.export.micropython:MicroPython",
        "onnx": "swarmwright.export.onnx:Onnx",
        "python": "swarmwright.export.python:Python",
        "ros1": "swarmwright.export.ros:Ros1",
        "ros2": "swarmwright.export.ros:Ros2",
        "scxml": "swarmwright.export.scxml:Scxml",
    },
    "swarmwright.export:Exporter",
)
"""All export formats, by their name after `--to`."""
