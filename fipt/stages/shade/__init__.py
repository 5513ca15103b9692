"""Shading: bake in round 0, refinement in later rounds."""
