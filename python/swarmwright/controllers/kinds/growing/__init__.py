"""Growing networks of NEAT, whose weights are genes of nodes and connections."""
