"""Everything that acts in simulated worlds: maps, simulators, tasks, episodes and the actor process."""
