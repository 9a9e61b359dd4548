"""Figures of a process for Prometheus: an HTTP page that is made anew whenever somebody asks for it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from common.errors import ConfigError
from common.system.closing import Closing
from common.system.extras import optional

Values = dict[tuple[str, ...], float]
"""A figure by the values of its labels."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure with all its values.

    Attributes:
        name: in Prometheus, a counter without its suffix ``_total``.
        text: what it means, one sentence.
        values: by the values of the labels, in their order; the empty tuple where there are none.
        labels: names of the labels.
        kind: whether it only ever grows.
    """

    name: str
    text: str
    values: Values
    labels: tuple[str, ...] = ()
    kind: Literal["gauge", "counter"] = "gauge"


class MetricsServer(Closing):
    """Serves figures under ``/metrics`` until it is closed.

    Args:
        address: host and port; port 0 lets the system choose.
        collect: returns the figures; called for each request, from a thread of its own.

    Attributes:
        port: where it listens.

    Raises:
        ConfigError: the address cannot be used, or the extra `metrics` is not installed.
    """

    def __init__(self, address: tuple[str, int], collect: Callable[[], Iterable[Figure]]) -> None:
        with optional("--metrics", "metrics"):
            from prometheus_client import CollectorRegistry, start_http_server
            from prometheus_client.registry import Collector

        class Figures(Collector):
            def collect(self) -> Iterator[Any]:
                return map(_family, collect())

            def describe(self) -> list[Any]:
                return []  # nothing is collected before somebody asks

        # Without names, so that a request for some figures (`?name[]=hd_steps`) looks through what is collected for it.
        registry = CollectorRegistry(auto_describe=False, support_collectors_without_names=True)
        registry.register(Figures())
        host, port = address
        try:
            self._server, self._thread = start_http_server(port, host, registry)
        except OSError as error:
            raise ConfigError(f"--metrics cannot listen on {host}:{port}: {error.strerror or error}") from error
        self.port: int = self._server.server_port

    def close(self) -> None:
        """Stop serving; safe to call twice."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


def _family(figure: Figure) -> Any:
    from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

    kind = CounterMetricFamily if figure.kind == "counter" else GaugeMetricFamily
    family = kind(figure.name, figure.text, labels=figure.labels)
    for labels, value in figure.values.items():
        family.add_metric(list(labels), value)
    return family
