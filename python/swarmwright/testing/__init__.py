"""Conformance checks for tests of plug-ins, simulations in Python and simulation servers.

    import swarmwright.testing

    def test_conformance():
        swarmwright.testing.check_method("my_method")

    def test_my_server_speaks_the_protocol():
        swarmwright.testing.check_server("java -jar my-server.jar {broker} {id}", simulation="rovers")

A check raises AssertionError with the violated rule. The same checks run for all built-in components.
"""

from swarmwright.testing._controllers import check_behaviour, check_condition, check_representation
from swarmwright.testing._methods import check_method, check_ranking
from swarmwright.testing._servers import check_launcher, check_optimizer, check_server
from swarmwright.testing._simulations import check_batch_simulation, check_simulation

__all__ = [
    "check_batch_simulation",
    "check_behaviour",
    "check_condition",
    "check_launcher",
    "check_method",
    "check_optimizer",
    "check_ranking",
    "check_representation",
    "check_server",
    "check_simulation",
]
