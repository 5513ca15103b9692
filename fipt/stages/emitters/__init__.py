"""Emitters: what emits, where its edges are, and light that no view shows."""
