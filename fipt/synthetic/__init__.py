"""A room in code or of a scene file: geometry and materials, camera poses, HDR views with ground truth."""
