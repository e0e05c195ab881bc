"""What to write where a simulation is named by its file alone, without a class."""

from pathlib import Path

from swarmwright.simulations.loading import classes_of_file


def class_missing(name: str, folder: Path | None = None) -> str:
    """Say that a class has to be named, and which ones the file has.

    Args:
        name: the path of the file, as it was given.
        folder: that it is relative to; default: the working folder.

    Raises InputError when there is no such file, or it cannot be imported.
    """
    classes = classes_of_file((folder or Path()) / name)
    there = (
        f"{name} has {', '.join(classes)}" if classes else f"{name} has no subclass of swarmwright.Simulation"
    )
    write = f": write {name}:{classes[0]}" if classes else ""
    return f"a simulation in Python is named by its file and its class; {there}{write}"
