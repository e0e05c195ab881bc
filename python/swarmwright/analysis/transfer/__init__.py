"""Transfer: candidates of a run in other simulators, or in perturbed models of their own simulation."""
