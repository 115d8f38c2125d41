"""From a flight log to the attitude response: what `companion identify` and `companion design` stand on."""
