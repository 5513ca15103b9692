"""Segment ids: of every view by a network or as given, and fused on the mesh so that all views agree."""
