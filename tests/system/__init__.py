"""The whole system: real processes on a real bus."""
