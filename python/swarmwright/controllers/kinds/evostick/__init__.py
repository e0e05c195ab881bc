"""EvoStick: a fixed network from sensors to wheels."""
