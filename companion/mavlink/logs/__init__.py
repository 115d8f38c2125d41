"""The logs of a vehicle: listed and fetched by MAVLink FTP or the log protocol, and checked for completeness."""
