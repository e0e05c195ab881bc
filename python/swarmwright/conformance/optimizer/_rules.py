"""The table of the rules for optimization tools; each group is a file beside this one."""

from swarmwright.conformance.rules import Rules

GROUPS = {
    "O1": "Discovery",
    "O2": "Episodes",
    "O3": "Actuators",
    "O4": "Wrong messages",
    "O5": "Servers that fail",
    "O6": "Extensions",
    "O7": "The end",
}
RULES = Rules("optimizer", GROUPS)
rule = RULES.rule
