"""What is done to a foreign mesh before anything refers to its triangles: clean, smooth, flatten, decimate, cut."""
