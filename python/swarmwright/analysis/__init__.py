"""Analysis of many runs: comparisons with statistical tests, diversity, sweeps."""
