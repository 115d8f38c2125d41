"""Pre-flight certificate: is the attitude loop fast enough, proven exactly."""
