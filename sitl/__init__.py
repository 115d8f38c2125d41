"""The plant: vehicle models and a PX4-like autopilot that speaks MAVLink."""
