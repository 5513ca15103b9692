"""Shading: first hits, radiance cache, bake and refinement."""
