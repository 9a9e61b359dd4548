"""What travels on the bus: records, their bytes, and the checks that every received message must pass."""
