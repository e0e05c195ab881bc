"""All pictures that are made with Matplotlib: fitness, diversity, comparisons, controllers."""
