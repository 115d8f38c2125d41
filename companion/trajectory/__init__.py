"""Trajectories as data: position, velocity, acceleration, jerk, snap and heading over time. Pure floats.

What is flown is evaluated without numpy; only the planning of `minimum_snap` needs it, before flight.
"""
