"""Signed distance and radiance of a room, fitted to its photographs by volume rendering."""
