"""Covering tours: which viewpoints to visit so that little enough stays unseen, and in which order."""
