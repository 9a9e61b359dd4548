"""`python -m learner` is `hd-learner`."""

from learner.cli import app

app()
