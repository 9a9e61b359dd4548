"""Evaluation: runs planners on worlds, recounts what they did, compares them and shows it."""
