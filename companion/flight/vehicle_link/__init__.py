"""The vehicle over MAVLink: the only room of the flight process that knows the protocol."""
