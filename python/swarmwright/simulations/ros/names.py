"""Names of topics and services in the graph of ROS."""

from __future__ import annotations

import re

_TOKEN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


def resolve(name: str, namespace: str = "/", node: str = "node") -> str:
    """Return the absolute name: `scan` in the namespace `/robot_1` is `/robot_1/scan`.

    Args:
        name: absolute (`/scan`), relative (`scan`), or private to the node (`~/steps`).
        namespace: namespace of the node, with or without the first `/`.
        node: its name, for private names.

    Raises ValueError, with the reason, if the name is not valid.
    """
    if not name:
        raise ValueError("the name is empty")
    inside = namespace.strip("/")
    if name.startswith("/"):
        full = name[1:]
    elif name == "~" or name.startswith("~/"):
        full = "/".join(filter(None, [inside, node])) + name[1:]
    else:
        full = f"{inside}/{name}" if inside else name
    for token in full.split("/"):
        if not token:
            raise ValueError("contains // or ends with /")
        if not _TOKEN.fullmatch(token):
            raise ValueError(
                f"'{token}' is not valid in a name: expected a letter or _, then letters, digits and _"
            )
    return f"/{full}"


def namespace_of(name: str) -> str:
    """Return a namespace in its full form: `robot_1` is `/robot_1`, an empty one `/`.

    Raises ValueError, with the reason, if the namespace is not valid.
    """
    inside = name.strip("/")
    return resolve(f"/{inside}") if inside else "/"
