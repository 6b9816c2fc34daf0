"""Solvers of small finite POMDPs: the optimum, bounds on it, and exact values of given policies."""
