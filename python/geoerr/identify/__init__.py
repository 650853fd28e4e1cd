"""Observations to the 21 geometric errors."""
