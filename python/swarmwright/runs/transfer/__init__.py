"""Evaluation of a run's candidates in other simulations, or in perturbed models of their simulation."""
