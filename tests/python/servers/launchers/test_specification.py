import pytest

from swarmwright.servers.launchers._base import Specification


@pytest.mark.parametrize("prefix", ["", "lab1"])
def test_the_prefix_is_that_of_the_run_whatever_the_environment_there_has(prefix: str) -> None:
    arguments = Specification("minisim", "mqtt://lab:1883", prefix=prefix).arguments(7)
    assert arguments[arguments.index("--prefix") + 1] == prefix
