"""Geometry: depth maps of posed views, and the mesh that they make."""
