"""Behaviours and conditions of machines: the engine's, and those that are written in Python."""

from swarmwright.modules._base import Behaviour, Condition, Parameter, RandomNumbers, Senses
from swarmwright.modules.registered import BEHAVIOURS, CONDITIONS

__all__ = ["BEHAVIOURS", "CONDITIONS", "Behaviour", "Condition", "Parameter", "RandomNumbers", "Senses"]
