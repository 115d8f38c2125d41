"""What tests and benchmarks share: one fake autopilot, one free port, one way to start a process."""
