"""Albedo as radiance over irradiance: a baseline without a fit."""
