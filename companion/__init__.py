"""Adaptive position control for PX4: controller, certificate, flight process."""

__version__ = "0.1.0"
