"""Where a run's curves go: TensorBoard always, MLflow and Weights & Biases by option (`tracking.writers`)."""

from __future__ import annotations

import json
import logging
import os
import time
import uuid
import warnings
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Final, Protocol

from common.config import RunConfig
from common.system.documents import read_json
from common.system.extras import optional
from learner.run.files import replace_text, to_json

logger = logging.getLogger(__name__)

NAMES_FILE = "tracking.json"
"""In a run's folder: the names under which trackers know it, so that a resumed run continues there."""
_LONGEST_PARAMETER = 500


class Writer(Protocol):
    """Takes the points of a run's curves; the horizontal axis is the number of updates."""

    def write(self, update: int, values: Mapping[str, float]) -> None:
        """Write one point of each curve."""
        ...

    def text(self, name: str, content: str) -> None:
        """Write a text, such as the configuration."""
        ...

    def summary(self, values: Mapping[str, Any]) -> None:
        """Replace the figures that stand for the whole run."""
        ...

    def flush(self) -> None:
        """Bring all points to where they are kept."""
        ...

    def close(self) -> None:
        """Flush and close; safe to call twice."""
        ...


def make_writers(folder: Path, config: RunConfig) -> list[Writer]:
    """Make the writers beside TensorBoard that a configuration names.

    Args:
        folder: of the run; all runs of its parent folder share one MLflow database there.
        config: of the run.

    Raises:
        MissingPackageError: a tracker is not installed.
    """
    made: list[Writer] = []
    for name in config.tracking.writers:
        made.append(_Tolerant(name, _MAKERS[name](folder, config)))
    return made


def check_writers(config: RunConfig) -> None:
    """Raise MissingPackageError where a tracker is named that is not installed, before a run is made."""
    for name in config.tracking.writers:
        with optional(f"tracking.writers={name}", name, instead=f"leave {name} out"), _Quiet():
            import_module(name)


class MlflowWriter:
    """Writes into MLflow: a database beside the runs, or the server that `tracking.mlflow_uri` names.

    ``mlflow ui --backend-store-uri sqlite:///runs/mlflow.db`` shows it.
    """

    def __init__(self, folder: Path, config: RunConfig) -> None:
        check_writers(config)
        with _Quiet():
            from mlflow import MlflowClient
            from mlflow.entities import Metric, Param
        self._metric = Metric
        uri = config.tracking.mlflow_uri or f"sqlite:///{folder.parent.resolve() / 'mlflow.db'}"
        with _Quiet():
            self._client = MlflowClient(tracking_uri=uri)
            project = config.tracking.project
            found = self._client.get_experiment_by_name(project)
            experiment = self._client.create_experiment(project) if found is None else found.experiment_id
            names = _names(folder)
            if "mlflow" not in names:
                run = self._client.create_run(experiment, run_name=config.name)
                names["mlflow"] = run.info.run_id
                parameters = [Param(name, value[:_LONGEST_PARAMETER]) for name, value in flat(config).items()]
                for first in range(0, len(parameters), 100):
                    self._client.log_batch(names["mlflow"], params=parameters[first : first + 100])
                _remember(folder, names)
            self._run: str = names["mlflow"]
            self._client.update_run(self._run, status="RUNNING")
        self._closed = False

    def write(self, update: int, values: Mapping[str, float]) -> None:
        """Write one point of each curve."""
        now = int(1000 * time.time())
        with _Quiet():
            self._client.log_batch(
                self._run, metrics=[self._metric(name, float(value), now, update) for name, value in values.items()]
            )

    def text(self, name: str, content: str) -> None:
        """Write a text as a tag of the run."""
        with _Quiet():
            self._client.set_tag(self._run, name, content[:5000])

    def summary(self, values: Mapping[str, Any]) -> None:
        """Write the figures of the whole run as tags."""
        with _Quiet():
            for name, value in values.items():
                self._client.set_tag(self._run, f"summary.{name}", str(value))

    def flush(self) -> None:
        """Do nothing: every point is written at once."""

    def close(self) -> None:
        """Mark the run as ended; safe to call twice."""
        if not self._closed:
            self._closed = True
            with _Quiet():
                self._client.set_terminated(self._run)


class WandbWriter:
    """Writes into Weights & Biases, offline into the run's folder unless WANDB_MODE says otherwise.

    ``wandb sync runs/NAME/wandb/offline-run-*`` uploads what was written offline.
    """

    def __init__(self, folder: Path, config: RunConfig) -> None:
        check_writers(config)
        import wandb

        names = _names(folder)
        names.setdefault("wandb", uuid.uuid4().hex[:16])
        _remember(folder, names)
        with _Quiet():
            self._run: Any = wandb.init(
                project=config.tracking.project,
                name=config.name,
                id=names["wandb"],
                resume="allow",
                dir=str(folder),
                config=config.model_dump(mode="json"),
                mode=os.environ.get("WANDB_MODE", "offline"),
                settings=wandb.Settings(silent=True),
            )

    def write(self, update: int, values: Mapping[str, float]) -> None:
        """Write one point of each curve."""
        with _Quiet():
            self._run.log(dict(values), step=update)

    def text(self, name: str, content: str) -> None:
        """Write a text into the summary."""
        self._run.summary[name] = content

    def summary(self, values: Mapping[str, Any]) -> None:
        """Write the figures of the whole run into the summary."""
        with _Quiet():
            self._run.summary.update(dict(values))

    def flush(self) -> None:
        """Do nothing: a process of its own writes."""

    def close(self) -> None:
        """End the run; safe to call twice."""
        if self._run is not None:
            with _Quiet():
                self._run.finish()
            self._run = None


_MAKERS: Final[Mapping[str, Callable[[Path, RunConfig], Writer]]] = {"mlflow": MlflowWriter, "wandb": WandbWriter}


class _Tolerant:
    """Ends tracking, not training, when a tracker fails: its server may be away, its disk full."""

    def __init__(self, name: str, writer: Writer) -> None:
        self._name = name
        self._writer: Writer | None = writer

    def write(self, update: int, values: Mapping[str, float]) -> None:
        self._do("write", update, values)

    def text(self, name: str, content: str) -> None:
        self._do("text", name, content)

    def summary(self, values: Mapping[str, Any]) -> None:
        self._do("summary", values)

    def flush(self) -> None:
        self._do("flush")

    def close(self) -> None:
        self._do("close")

    def _do(self, method: str, *arguments: Any) -> None:
        if self._writer is None:
            return
        try:
            getattr(self._writer, method)(*arguments)
        except Exception:
            # Trackers raise errors of many kinds; none of them is worth a training of many hours.
            self._writer = None
            logger.exception(
                "tracking by %s failed: it is disabled until the run is resumed; TensorBoard continues",
                self._name,
            )


class _Quiet(warnings.catch_warnings):
    """Silences the warnings of trackers about their own parts, which a user of ours can do nothing about."""

    def __enter__(self) -> None:
        super().__enter__()
        warnings.simplefilter("ignore")


def flat(config: RunConfig) -> dict[str, str]:
    """Return all settings by their dotted names."""
    found: dict[str, str] = {}

    def walk(prefix: str, value: Any) -> None:
        if isinstance(value, dict):
            for name, inner in value.items():
                walk(f"{prefix}.{name}" if prefix else name, inner)
        else:
            found[prefix] = value if isinstance(value, str) else json.dumps(value)

    walk("", config.model_dump(mode="json"))
    return found


def _names(folder: Path) -> dict[str, str]:
    path = folder / NAMES_FILE
    return dict(read_json(path)) if path.is_file() else {}


def _remember(folder: Path, names: Mapping[str, str]) -> None:
    replace_text(folder / NAMES_FILE, to_json(dict(names)))
