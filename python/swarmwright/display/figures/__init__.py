"""Figures made with Matplotlib: fitness, diversity, comparisons, controllers."""
