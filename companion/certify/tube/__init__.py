"""How far from its trajectory a bounded disturbance drives a certified loop."""
