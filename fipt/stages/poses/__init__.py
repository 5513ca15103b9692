"""Cameras from pictures: matching, mapping, evidence, metres and up."""
