"""The table of the rules for simulation servers; each group is a file beside this one."""

from swarmwright.conformance.rules import Rules

GROUPS = {
    "S1": "Discovery",
    "S2": "Episodes",
    "S3": "Determinism",
    "S4": "Actuators",
    "S5": "Wrong messages",
    "S6": "Being taken",
    "S7": "Presence and announcement",
    "S8": "Metrics",
    "S9": "Offloaded evaluation",
    "S10": "Batches",
    "S11": "The connection",
    "S12": "Speed",
    "S13": "The end",
    "S14": "Scenes",
    "S15": "Control on the server's own topic",
    "S16": "Two servers with one ID",
}
RULES = Rules("server", GROUPS)
rule = RULES.rule
