"""Pole balancing: one pole or two, with velocities or without."""
