"""Many flights: the closed loop of controller, autopilot and vehicle compiled, without MAVLink between them."""
