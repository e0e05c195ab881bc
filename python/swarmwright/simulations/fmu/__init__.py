"""FMUs as simulations: what they announce, and the program that steps them."""
