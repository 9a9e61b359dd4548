"""Train a policy in this one process, export it, and let it drive: half a minute, far too short to learn much.

Run it as ``python examples/train.py``; it writes runs/example and example.safetensors. Real runs have real settings
(`hd-learner start --preset workstation`), and actors in processes of their own.
"""

from pathlib import Path

from rich.console import Console

from hdplanner import evaluate, load_config
from learner.run.export import export_policy
from learner.run.folder import RunFolder
from learner.serial import run_serial

WORLDS = "generator:rooms?width=256&height=192"

SETTINGS = [
    "name=example",
    f"maps.train={WORLDS}",
    "simulator.name=grid",
    "network.width=16",
    "network.heads=2",
    "network.layers=1",
    "replay.min_steps=100",
    "learner.batch_size=16",
    "learner.updates_per_step=0.25",
    "learner.total_updates=50",
    "learner.threads=1",
]


def main() -> None:
    """Train, export, evaluate."""
    config = load_config(overrides=SETTINGS)
    with RunFolder.create(Path("runs"), config, overwrite=True) as run:
        run_serial(run, Console(stderr=True), resume=False)
    policy = Path("example.safetensors")
    card = export_policy(Path("runs/example"), "last", policy)
    (result,) = evaluate("hdplanner", [WORLDS], count=1, policy=policy)
    print(f"{policy}: {card.updates} updates, {card.steps} steps; drove {result.distance_m:.0f} m in {result.map}")


if __name__ == "__main__":
    main()
