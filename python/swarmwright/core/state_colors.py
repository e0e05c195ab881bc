"""Colours of the states of controllers on a light ground, the same in diagrams, films and pages."""

STATE_COLORS = (
    "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#B59A00", "#8C8C8C",
    "#221188", "#BB55FF", "#AAEE77", "#663300", "#DD2244", "#881177", "#DDCC99", "#0033FF",
    "#EEDD00", "#773355", "#446633", "#DD9955", "#AA77EE", "#FF77DD", "#2255BB", "#00EEDD",
)  # fmt: skip
"""By state; the first eight are Okabe and Ito's, the others as far apart from all as there are."""


def state_color(state: int) -> str:
    """Return the colour of a state, as '#0072B2'; more states than there are colours have them again."""
    return STATE_COLORS[state % len(STATE_COLORS)]
