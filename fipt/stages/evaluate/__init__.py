"""Figures against ground truth and photographs; definitions in docs/method.md."""
