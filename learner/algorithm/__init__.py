"""The mathematics: batches, networks of the critics, losses, and the update that reads like the paper."""
