"""Behaviours and conditions of machines: the engine's, and those that are written in Python."""

from swarmwright.controllers.modules._base import Behaviour, Condition, Parameter, RandomNumbers, Senses
from swarmwright.controllers.modules.registered import BEHAVIOURS, CONDITIONS

__all__ = ["BEHAVIOURS", "CONDITIONS", "Behaviour", "Condition", "Parameter", "RandomNumbers", "Senses"]
