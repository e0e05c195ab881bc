"""What environments of Gymnasium, PettingZoo and VMAS have in common as simulations."""

NEW_EACH_EPISODE = "new_each_episode"
"""The option in a name that sets this attribute of the class, and is not passed to the environment."""
