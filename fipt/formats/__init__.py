"""File formats: bytes to arrays and back, no domain logic."""
