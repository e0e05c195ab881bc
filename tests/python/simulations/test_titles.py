"""Titles of other simulators, which are no simulations of this process."""

import re
from pathlib import Path

import pytest

from swarmwright import Experiment, InputError, simulate
from swarmwright.core.simulation_names import SIMULATORS
from swarmwright.simulations.titles import alike, not_here


def test_every_simulator_that_has_servers_is_known(root: Path) -> None:
    sources = [
        source
        for folder in ("wrappers/argos", "wrappers/stage", "wrappers/gazebo/src")
        for source in (root / folder).rglob("*.?pp")
        if "build" not in source.parts
    ]
    sources += (root / "python" / "swarmwright" / "adapters").rglob("*.py")
    found = {
        title
        for source in sources
        for title in re.findall(r'"((?:arena-[a-z0-9]+)|argos|stage)"', source.read_text(encoding="utf-8"))
    }
    assert found == set(SIMULATORS)


@pytest.mark.parametrize(("title", "page"), SIMULATORS.items())
def test_their_pages_tell_of_them(root: Path, title: str, page: str) -> None:
    assert title in (root / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("arena-gazbo", "arena-gazebo"),
        ("arena_gazebo", "arena-gazebo"),
        ("gazebo", "arena-gazebo"),
        ("mujoco", "arena-mujoco"),
        ("arina", "arena"),
    ],
)
def test_a_near_miss(written: str, meant: str) -> None:
    assert alike(written) == f"; did you mean '{meant}'?"
    assert not_here(written).startswith(
        f"unknown simulation {written!r}; did you mean '{meant}'? available: arena,"
    )


@pytest.mark.parametrize("title", ["arena", "arena-gazebo", "stage", "file.py:Class"])
def test_what_is_known_is_not_corrected(title: str) -> None:
    assert alike(title) == ""


def test_where_one_is_found_is_told() -> None:
    experiment = Experiment.from_mapping({"simulation": "arena-gazebo"})
    with pytest.raises(InputError) as caught:
        simulate(experiment, servers="local")
    assert str(caught.value) == (
        "simulation: 'arena-gazebo' is not built in: servers of another simulator offer it, see "
        "docs/how-to/attach-gazebo.md; name the broker on which one does"
    )
    with pytest.raises(InputError, match="needs a broker on which a server offers it, as arena-argos, "):
        simulate(Experiment.from_mapping({"simulation": "gazebo"}), servers="local")
