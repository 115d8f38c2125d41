"""Homogeneous polynomial Lyapunov functions of degree 2 and more, by sums of squares."""
