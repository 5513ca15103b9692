"""The stages: each folder holds its settings, its `run` and what it computes. No stage imports another."""
