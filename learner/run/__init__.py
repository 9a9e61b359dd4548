"""What a run leaves on the disk: folder, checkpoints, journal, episodes, evaluations, curves, exported policies."""
