"""Comparisons: what every method reached, in one table."""
