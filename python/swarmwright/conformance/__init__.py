"""Does a peer speak the protocol? Every rule of it, tried over a broker.

`swarmwright conformance` and `swarmwright.testing.check_server` use this.
"""

from swarmwright.conformance._check_optimizer import check_optimizer
from swarmwright.conformance._check_server import check_server
from swarmwright.conformance._results import Report, Result

__all__ = ["Report", "Result", "check_optimizer", "check_server"]
