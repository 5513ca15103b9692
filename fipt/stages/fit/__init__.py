"""Fit of the BRDF and emission networks to the photographs."""
