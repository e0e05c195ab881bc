"""What environments of Gymnasium, PettingZoo and VMAS have in common as simulations."""

NEW_EACH_EPISODE = "new_each_episode"
"""The option in a name that sets this attribute of the class, and is not passed to the environment."""
GROUP_BY = ("agent", "kind")
"""Values of the option `group_by`."""
CLASS_OPTIONS = {NEW_EACH_EPISODE: (True, False), "group_by": GROUP_BY}
"""Options in a name that set attributes of the class, with their values."""
