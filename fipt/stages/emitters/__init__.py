"""Emitting triangles: found from the mask and from radiance that no reflectance could give."""
