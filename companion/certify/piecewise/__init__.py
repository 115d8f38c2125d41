"""Piecewise quadratic Lyapunov functions on sectors, with the true delay; and the loop held over its tick."""
