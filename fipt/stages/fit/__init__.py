"""Fit of the material network, and of the emission network if there is one, to the photographs."""
