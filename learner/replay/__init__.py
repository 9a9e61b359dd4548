"""The replay buffer: ragged sequences in columnar rings."""
