"""The 89-state maze: table 7.3."""
