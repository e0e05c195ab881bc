"""Radio communication between the agents of a simulation in Python, as ns-3 computes it.

`Radios` takes the agents' positions and messages in each step and returns what arrives: with range, loss,
delay and bandwidth. ns-3 runs in the same process, `pip install 'swarmwright[ns3]'`.

Source: Riley and Henderson, The ns-3 Network Simulator, 2010, https://www.nsnam.org.
"""

from swarmwright.simulations.ns3._radios import Delivery, Radios

__all__ = ["Delivery", "Radios"]
