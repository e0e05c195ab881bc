"""Check a peer against every rule of the protocol, over a broker.

`swarmwright conformance` and `swarmwright.testing.check_server` use this package.
"""

from importlib.util import find_spec

from swarmwright.common.errors import InputError

if find_spec("paho") is None or find_spec("msgpack") is None:
    raise InputError(
        "the conformance kit needs paho-mqtt and msgpack: pip install 'swarmwright[conformance]'"
    )

from swarmwright.conformance._check import check_optimizer, check_server
from swarmwright.conformance.results import Report, Result

__all__ = ["Report", "Result", "check_optimizer", "check_server"]
