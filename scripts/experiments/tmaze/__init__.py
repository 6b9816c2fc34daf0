"""The T-maze: figure 3.4, and beyond it."""
