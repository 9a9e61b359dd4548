"""The best policy of a run: chosen by complete rounds of evaluation, saved beside the checkpoints."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from common.errors import CheckpointError
from common.policies.policy_file import PolicyCard
from learner.run.checkpoints import CheckpointStore
from learner.run.evaluation import Round, Score

Policy = Mapping[str, NDArray[Any]]

logger = logging.getLogger(__name__)

VALIDATION = "validation"
"""Key of a best policy's document, beside those of its card: what its evaluation depended on."""


class PublishedPolicies:
    """The policies published of late, so that the best version can be saved when its evaluation ends much later.

    Args:
        keep: newest versions to keep; versions under evaluation stay beyond that.
    """

    def __init__(self, keep: int = 32) -> None:
        self._keep = keep
        self._policies: dict[int, tuple[int, Policy]] = {}

    def add(self, version: int, updates: int, policy: Policy, pinned: set[int]) -> None:
        """Remember a published policy; forget the oldest beyond the limit that are not ``pinned``."""
        self._policies[version] = (updates, policy)
        for old in sorted(self._policies)[: -self._keep]:
            if old not in pinned:
                del self._policies[old]

    def get(self, version: int) -> tuple[int, Policy] | None:
        """Return (updates, weights) of a version, None when it is no longer here."""
        return self._policies.get(version)


class BestPolicy:
    """Keeps the policy with the best evaluation in the checkpoint that `best` points at.

    Args:
        checkpoints: of the run.
        describe: makes the card of a policy from its version, its updates and its evaluation.
        validation: what its figures depend on besides the policy; see `validation_of`.
    """

    def __init__(
        self,
        checkpoints: CheckpointStore,
        describe: Callable[[int, int, dict[str, float]], PolicyCard],
        validation: Mapping[str, Any],
    ) -> None:
        self._checkpoints = checkpoints
        self._describe = describe
        self._validation = dict(validation)
        self._published = PublishedPolicies()
        self.version = -1
        """Version of the best policy, -1 before the first complete evaluation."""
        self.figures: dict[str, float] = {}
        """Its means over the validation worlds, see `Round.figures`."""
        self._score: Score | None = None
        self._recall()

    def remember(self, version: int, updates: int, weights: Policy, pinned: set[int]) -> None:
        """Keep a published policy for the time that its evaluation takes; see `PublishedPolicies.add`."""
        self._published.add(version, updates, weights, pinned)

    def consider(self, finished: Round) -> None:
        """Save the evaluated policy when it is the best so far."""
        means = finished.means
        ratios = "".join(f", {name} {value:.3f}" for name, value in finished.ratios.items())
        logger.info(
            "evaluation of version %d: %.0f%% complete, %.1f m, %.1f%% explored%s",
            finished.version,
            100 * means.success,
            means.distance,
            100 * means.explored,
            ratios and f"; shares of the classical planner's distance: {ratios[2:]}",
        )
        score = Score.of(finished.figures)
        if self._score is not None and score <= self._score:
            return
        policy = self._published.get(finished.version)
        if policy is None:
            logger.warning(
                "version %d is the best so far, but its weights are no longer here: publish less often "
                "(learner.publish_every)",
                finished.version,
            )
            return
        updates, weights = policy
        card = self._describe(finished.version, updates, finished.figures)
        document = {**asdict(card), "network": card.network.model_dump(), "mapping": card.mapping.model_dump()}
        document[VALIDATION] = self._validation
        tensors = {name: torch.from_numpy(np.array(array)) for name, array in weights.items()}
        folder = self._checkpoints.save_best(finished.version, tensors, document)
        self.version, self.figures, self._score = finished.version, finished.figures, score
        logger.info("best policy so far: version %d, saved as %s", finished.version, folder.name)

    def _recall(self) -> None:
        name = self._checkpoints.pointer("best")
        if name is None:
            return
        try:
            document = self._checkpoints.load(name).document
            score = Score.of(document["evaluation"])
            self.figures = dict(document["evaluation"])
            self.version = int(document["version"])
            # Earlier releases noted none.
            now, then = self._validation, dict(document.get(VALIDATION, {}))
            changed = [key for key in {**then, **now} if then and now.get(key) != then.get(key)]
        except (CheckpointError, KeyError, TypeError, ValueError) as error:
            aside = self._checkpoints.set_aside(name)
            self._checkpoints.mend_pointers()
            logger.error(
                "the best policy is set aside in %s, and the next evaluation counts as the best: %s", aside, error
            )
            return
        if changed:
            logger.warning(
                "%s was evaluated with another %s, so the next evaluation takes its place, whatever its figures: "
                "export it before then if it is still of use",
                name,
                ", ".join(changed),
            )
            return
        self._score = score
