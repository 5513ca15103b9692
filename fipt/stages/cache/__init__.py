"""The radiance cache over the surface."""
