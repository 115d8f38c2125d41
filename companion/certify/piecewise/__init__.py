"""Piecewise quadratic Lyapunov functions on sectors, with the true delay."""
