"""Baselines: what a return is compared with before it reinforces the actions that led to it (section 3.3.2)."""
