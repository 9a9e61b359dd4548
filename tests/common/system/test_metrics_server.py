"""Figures for Prometheus: what a scrape reads."""

import urllib.request

import pytest

from common.errors import ConfigError
from common.system.metrics_server import Figure, MetricsServer


def scrape(port: int, query: str = "") -> dict[str, float]:
    """The samples of a page, by name and labels as Prometheus writes them."""
    from prometheus_client.parser import text_string_to_metric_families

    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics{query}", timeout=10) as page:
        families = text_string_to_metric_families(page.read().decode())
    return {
        sample.name + "".join(f",{k}={v}" for k, v in sorted(sample.labels.items())): sample.value
        for family in families
        for sample in family.samples
    }


def test_each_scrape_reads_the_figures_of_its_moment():
    now = {"steps": 3.0}

    def collect():
        yield Figure("hd_steps", "Steps.", {(): now["steps"]}, kind="counter")
        yield Figure("hd_lag", "Lag.", {("a-0", "desk"): 2.0, ("a-1", "desk"): 0.5}, ("actor", "host"))

    with MetricsServer(("127.0.0.1", 0), collect) as server:
        assert scrape(server.port) == {
            "hd_steps_total": 3.0,
            "hd_lag,actor=a-0,host=desk": 2.0,
            "hd_lag,actor=a-1,host=desk": 0.5,
        }
        assert scrape(server.port, "?name[]=hd_steps_total") == {"hd_steps_total": 3.0}
        assert scrape(server.port, "?name[]=hd_lag&name[]=other").keys() == {
            "hd_lag,actor=a-0,host=desk",
            "hd_lag,actor=a-1,host=desk",
        }
        now["steps"] = 4.0
        assert scrape(server.port)["hd_steps_total"] == 4.0
        with pytest.raises(ConfigError, match=r"cannot listen on 127\.0\.0\.1"):
            MetricsServer(("127.0.0.1", server.port), collect)
