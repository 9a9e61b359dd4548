"""The learner process: ingest, replay, losses, training loop, checkpoints and metrics."""
