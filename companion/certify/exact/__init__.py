"""Exact arithmetic of the verifier. Standard library only."""
