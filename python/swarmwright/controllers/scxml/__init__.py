"""State machines in SCXML (W3C, "State Chart XML", 2015) as controllers of the kind `mealy_fsm`, and back.

It reads a subset: states, also parallel ones and with histories, transitions on comparisons of sensors with
numbers, actuators that are assigned or sent, events of the machine for itself.
"""

from swarmwright.controllers.scxml._machine import StateMachine
from swarmwright.controllers.scxml._read import read
from swarmwright.controllers.scxml._write import scxml_of

__all__ = ["StateMachine", "read", "scxml_of"]
