"""Known rooms as a source of scenes: datasets with ground truth, and captures of a simulated camera."""
