"""What every process of the system shares: configuration, bus, messages, belief and graph, network."""
