"""Racing: the rules, a track of our own, and how it is drawn. TORCS drives by the same rules."""
