"""Traffic in SUMO as a swarm: vehicles, or traffic lights, are the agents.

`simulation: swarmwright.simulations.sumo:Vehicles`, or `:TrafficLights`, with `parameters: {config:
town.sumocfg}`. SUMO runs in the same process (libsumo), `pip install 'swarmwright[sumo]'`.

Source: Alvarez Lopez et al., Microscopic Traffic Simulation using SUMO, ITSC 2018, https://sumo.dlr.de.
"""

from swarmwright.simulations.sumo._traffic import Traffic, TrafficLights, Vehicles

__all__ = ["Traffic", "TrafficLights", "Vehicles"]
