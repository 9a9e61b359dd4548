"""Looks at what a run needs before its folder is made: what is missing should not turn up minutes later.

Kernels take minutes to compile on a fresh machine, and a run that has begun wants to be resumed or overwritten.
"""

from __future__ import annotations

from collections.abc import Mapping

from common.config import RunConfig
from common.system.addresses import check_free
from common.system.remote_files import RemoteFolder
from learner.algorithm.compiled import check_compiler
from learner.algorithm.device import choose_device
from learner.algorithm.initial_policy import initial_weights
from learner.watch.writers import check_writers


def check_needs(config: RunConfig, listens: Mapping[str, tuple[str, int]], *, begins: bool) -> None:
    """Raise what the run would raise later, in the same words where the same code can say it.

    Args:
        config: of the run.
        listens: host and port by the option that asks for them.
        begins: the run is new, so that its initial policy counts.

    Raises:
        CheckpointError: the initial policy cannot be read.
        ConfigError: the device is not there or cannot be compiled for, a port is taken, or the mirror's URL cannot be
            used.
        MissingPackageError: a tracker is not installed.
        WeightsError: the initial policy does not fit the network.
    """
    for option, (host, port) in listens.items():
        check_free(host, port, option)
    check_writers(config)
    device = choose_device(config.learner.device)
    if config.learner.compile:
        check_compiler(device)
    if config.checkpoints.mirror is not None:
        RemoteFolder(config.checkpoints.mirror)
    if begins:
        initial_weights(config)
