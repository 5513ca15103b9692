"""Light from outside: the radiance of rays that leave the mesh."""
