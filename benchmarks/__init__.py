"""Speed of the stages beside a plain implementation of the published method: ``python -m benchmarks``."""
