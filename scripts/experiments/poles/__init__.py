"""Poles: tables 3.1, 4.2, 5.1 and 7.4."""
