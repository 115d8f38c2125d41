"""A flight on disk: the config as used, `traffic.tlog` and `flight.mcap`, written by a process of its own."""
