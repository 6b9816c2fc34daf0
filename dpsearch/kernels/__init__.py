"""Ground floor: the layout of lanes, keyed randomness, and the arithmetic that compiled rollouts are made of."""
