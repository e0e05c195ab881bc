"""State machines in SCXML (W3C, "State Chart XML", 2015) as controllers of the kind `mealy_fsm`, and back.

A subset is supported: states, also parallel states and histories, transitions on comparisons of sensors with
numbers, actuators that are assigned or sent, and events that the machine raises or sends to itself.
"""

from swarmwright.controllers.scxml._machine import StateMachine
from swarmwright.controllers.scxml._read import read
from swarmwright.controllers.scxml._write import to_scxml

__all__ = ["StateMachine", "read", "to_scxml"]
