"""FMUs as simulations: their descriptions, and the program that steps them."""
