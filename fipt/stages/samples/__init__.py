"""Footprint samples: what surface every pixel shows, traced once."""
