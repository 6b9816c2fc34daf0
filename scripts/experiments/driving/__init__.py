"""Racing: section 3.4.4."""
