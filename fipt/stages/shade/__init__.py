"""Shading: footprint samples, radiance cache, bake and refinement."""
