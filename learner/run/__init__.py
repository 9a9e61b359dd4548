"""What a run leaves on the disk: folder, checkpoints, journal, episodes, exported policies."""
