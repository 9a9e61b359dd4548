"""Valid messages of every kind for the tests."""

import numpy as np

from common.messages.experience import Chunk, Delivery, End, EpisodeReport, ExpertLabels
from common.messages.replies import Ack, ControlReply, ControlRequest, Spec
from common.messages.stats import ActorStats, LearnerStats
from common.messages.view import EpisodeView
from common.messages.weights import Weights
from common.observations.observation import ObservationBatch
from tests.observations import TARGETS, random_observation


def chunk(rng, steps=3, end=End.NONE, labels=True, viewpoints=(2, 30), targets=TARGETS) -> Chunk:
    """Make a valid chunk with random observations and random choices."""
    observations = [
        random_observation(
            rng, int(rng.integers(viewpoints[0], viewpoints[1] + 1)), targets[rng.integers(len(targets))]
        )
        for _ in range(steps + (end is not End.NONE))
    ]
    decided = observations[:steps]
    choices = [o.waypoint_nodes() for o in decided]
    expert = ExpertLabels(
        cost=rng.uniform(0, 50, sum(map(len, choices))).astype(np.float32),
        beacon=np.array([rng.choice([-1, *o.beacon_nodes()]) for o in decided], dtype=np.int32),
        remaining=rng.uniform(0, 500, steps).astype(np.float32),
        unseen=rng.uniform(0, 5000, steps).astype(np.float32),
    )
    return Chunk(
        episode=int(rng.integers(1000)),
        first_step=int(rng.integers(128)),
        observations=ObservationBatch.stack(observations),
        beacons=np.array([rng.choice(o.beacon_nodes()) for o in decided], dtype=np.int32),
        waypoints=np.array([rng.choice(nodes) for nodes in choices], dtype=np.int32),
        rewards=rng.normal(size=steps).astype(np.float32),
        versions=rng.integers(-1, 1000, steps),
        probabilities=rng.uniform(0, 1, steps).astype(np.float32),
        labels=expert if labels else None,
        end=end,
        family=int(rng.integers(256)),
    )


def delivery(rng, sequence=0, actor="desk-0", incarnation=7, **details) -> Delivery:
    return Delivery(actor, incarnation, sequence, chunk(rng, **details))


def report(**changes) -> EpisodeReport:
    values = {
        "task": "exploration",
        "map_name": "rooms-7",
        "simulator": "grid",
        "role": "train",
        "driver": "policy",
        "version": 3,
        "steps": 41,
        "distance": 260.5,
        "success": True,
        "explored": 0.998,
        "reward": 12.25,
        "collisions": 0,
        "duration": 3.5,
    }
    return EpisodeReport(**(values | changes))


def weights(version=1, value=0.5, **details) -> Weights:
    tensors = {
        "encoder.weight": np.full((8, 4), value, dtype=np.float32),
        "encoder.bias": np.zeros(8, dtype=np.float32),
    }
    return Weights.of(tensors, learner=details.pop("learner", 11), version=version, updates=10 * version, **details)


def view(rng, shape=(30, 40), viewpoints=12) -> EpisodeView:
    def places(count):
        return rng.uniform(-50, 50, (count, 2)).astype(np.float32)

    return EpisodeView(
        actor="desk-0",
        family="worlds",
        world="rooms-7",
        task="exploration",
        driver="policy",
        version=12,
        step=7,
        distance=31.5,
        explored=0.25,
        ended=False,
        success=False,
        resolution=0.5,
        origin=(-3.5, 2.25),
        cells=rng.choice(np.array([-1, 0, 100], np.int8), shape),
        viewpoints=places(viewpoints),
        kinds=rng.integers(0, 3, viewpoints).astype(np.uint8),
        edges=rng.integers(0, viewpoints, (20, 2)).astype(np.uint16),
        frontiers=places(9),
        beacons=places(3),
        way=places(8),
        beacon=places(1),
        waypoint=places(1),
        target=places(0),
    )


def small_messages() -> list[object]:
    """One message of every kind that has no arrays."""
    return [
        Ack(sequence=4, stored=True, hold=0.25, error="", learner=11),
        Spec(run="office", learner=11, config='{"name": "office"}'),
        weights().notice(),
        ActorStats(
            "desk-0", "desk", 4711, 1200, 9, 64.5, 12, 3.25, 0, "acting", 2, "was killed by SIGKILL: it said nothing"
        ),
        LearnerStats("gpu", 815, 12_000, 90, 750, 75, 500.0, 1.5, 11_000, "training"),
        ControlRequest("status", {}),
        ControlReply(True, "", {"updates": 750, "actors": ["desk-0"]}),
    ]
