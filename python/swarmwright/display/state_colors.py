"""Colours of controller states on a light background, shared by diagrams, videos and pages."""

STATE_COLORS = (
    "#0072B2", "#880044", "#99BB00", "#9900FF", "#CC7799", "#555500", "#55BBEE", "#FF6666",
    "#221188", "#BB55FF", "#AAEE77", "#663300", "#DD2244", "#881177", "#DDCC99", "#0033FF",
    "#EEDD00", "#773355", "#446633", "#DD9955", "#AA77EE", "#FF77DD", "#2255BB", "#00EEDD",
)  # fmt: skip
"""Colours by state. The first eight can be told apart with protanopia, deuteranopia and tritanopia, too:
simulated with the matrices of Machado, Oliveira and Fernandes (2009), their CIE76 differences are at least
25; their contrast to white and to the background of maps is at least 2. The others differ from all by at
least 15 in full colour vision."""

DISTINCT_STATES = 8
"""Number of leading STATE_COLORS that are distinguishable with every kind of colour vision."""


def state_color(state: int) -> str:
    """Return the colour of a state, as '#0072B2'; colours repeat for more states."""
    return STATE_COLORS[state % len(STATE_COLORS)]
