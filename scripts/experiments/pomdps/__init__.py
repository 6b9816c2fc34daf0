"""Small POMDPs: tables 6.1, 7.1 and 7.2."""
