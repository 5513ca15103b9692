"""Check of the cameras through the mesh."""
