"""Networks that grow: NEAT."""
