"""Networks whose weights change by Hebbian rules while they work."""
