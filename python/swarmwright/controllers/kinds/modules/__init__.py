"""State machines and behaviour trees of modules."""
