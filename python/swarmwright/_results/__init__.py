"""What comes of runs: which candidate is looked at, how runs compare, and their figures."""
