"""A furnished room in code: geometry and materials, camera poses, HDR views with ground truth."""
