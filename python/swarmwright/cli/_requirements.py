"""Packages that Swarmwright requires, and cannot use as they are installed."""

import re
from importlib import metadata

_PACKAGES = {"PIL": "pillow", "ruamel": "ruamel.yaml"}
"""Packages by the modules that are called otherwise, also where they are not installed."""
_REQUIREMENT = re.compile(r"(?P<package>[\w.-]+)\s*(?P<versions>[^;]*)(?P<marker>.*)")


def import_problem(error: ImportError) -> str | None:
    """Return which required package is missing or unsuitable, and what to install; None for other modules."""
    module = (error.name or "").partition(".")[0]
    if not module or module == "swarmwright":
        return None
    package = _PACKAGES.get(module) or next(iter(metadata.packages_distributions().get(module, ())), module)
    for owner in ("swarmwright", *_required("swarmwright")):
        versions = _required(owner).get(_normalized(package))
        if versions is None:
            continue
        try:
            found = f"{metadata.version(package)} cannot be used ({str(error).splitlines()[0]})"
        except metadata.PackageNotFoundError:
            found = "is not installed"
        needing = "Swarmwright" if owner == "swarmwright" else owner
        wanted = f"{package}{versions}"
        return f"the package {package} {found}: {needing} needs {wanted}: pip install '{wanted}'"
    return None


def _required(package: str) -> dict[str, str]:
    """Return the versions that a package requires of others, `>=2.10,<3`, without those of its extras."""
    try:
        lines = metadata.requires(package) or []
    except metadata.PackageNotFoundError:
        return {}
    found = [
        match for line in lines if (match := _REQUIREMENT.match(line)) and "extra" not in match["marker"]
    ]
    return {_normalized(one["package"]): one["versions"].strip() for one in found}


def _normalized(package: str) -> str:
    """Return the name of a package as it is compared."""
    return re.sub(r"[-_.]+", "-", package).lower()
