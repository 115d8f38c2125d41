"""Files as they are found, whole or not: bytes to samples that can be believed, and what the vehicle was doing."""
