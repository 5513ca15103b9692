"""Cameras from images: matching, mapping, evidence, metres and up."""
