"""The cards of a run's policies: what they are, and where they come from."""

from __future__ import annotations

import time

from common.config import RunConfig
from common.policies.policy_file import PolicyCard, portable_sources
from learner.rate_limiter import RateLimiter
from learner.run.code_state import code_state, commit_of


class PolicyCards:
    """Describes policies of a run.

    Args:
        config: of the run.
        limiter: counts the collected steps.

    Attributes:
        commit: of the code of this process.
        earlier_seconds: that the run had taken before this process began.
    """

    def __init__(self, config: RunConfig, limiter: RateLimiter) -> None:
        self._config = config
        self._limiter = limiter
        self.commit = commit_of(code_state())
        self._began = time.monotonic()
        self.earlier_seconds = 0.0

    @property
    def uptime(self) -> float:
        """Seconds since this process began."""
        return time.monotonic() - self._began

    @property
    def seconds(self) -> float:
        """Seconds that the run has taken, those of earlier processes included."""
        return self.earlier_seconds + self.uptime

    def describe(self, version: int, updates: int, evaluation: dict[str, float] | None = None) -> PolicyCard:
        """Return the card of a policy as it is now.

        Args:
            version: its number.
            updates: that it has had.
            evaluation: figures of its evaluation, where it had one.
        """
        config = self._config
        return PolicyCard(
            run=config.name,
            task=config.task_name,
            network=config.network,
            mapping=config.mapping,
            version=version,
            updates=updates,
            steps=self._limiter.steps,
            averaged=bool(config.learner.average_decay),
            commit=self.commit,
            created=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
            evaluation=evaluation,
            maps=portable_sources(config.training_sources),
            ranges=config.mapping_ranges,
            seed=config.seed,
            wall_seconds=round(self.seconds),
        )
