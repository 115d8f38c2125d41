"""MAVLink: bytes on a link to typed values and back. Nothing above this package touches a socket or a tty."""
