"""Black-box functions: chapters 4, 5 and 7."""
