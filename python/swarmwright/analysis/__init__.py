"""What many runs say: comparisons with statistical tests, diversity, sweeps."""
