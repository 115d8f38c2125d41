"""The plant's wires: sockets, serial lines, what a radio does to frames, and the clocks."""
