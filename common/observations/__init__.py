"""The observation, from the environment over the wire to the network."""
