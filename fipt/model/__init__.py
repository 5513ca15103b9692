"""What is fitted: reflectance, its encoding and networks."""
