"""The training loop."""

from __future__ import annotations

from learner.trainer import Trainer


def train(trainer: Trainer) -> None:
    """Train until the run is complete or told to stop, and leave a checkpoint of the end.

    Collecting runs beside the loop: the bus stores what actors send in threads of its own, and the declared ratio
    lets either side wait for the other.
    """
    trainer.publish()
    while not trainer.finished:
        if trainer.data_is_ready():
            batch = trainer.sample()
            if trainer.learn(batch):
                trainer.publish_if_due()
                trainer.record_if_due()
        trainer.serve()
    while not trainer.evaluation_is_ready():
        trainer.serve()
    trainer.finish()
