"""The processes that share each batch, joined by torch.distributed: gloo between CPUs, NCCL between GPUs.

All are on one machine and meet in a file of a private folder, so no port is open to others. A group is made anew
whenever a rank joins or is lost.
"""

from __future__ import annotations

import os
import socket
from contextlib import suppress
from datetime import timedelta
from pathlib import Path

import torch
from torch import Tensor

from common.errors import ConfigError
from common.system.closing import Closing
from learner.algorithm.base import RanksError

JOIN_SECONDS = 20.0
"""In which all ranks of a group must have come."""
STEP_SECONDS = 60.0
"""For which a rank waits for the slowest in one step of an update; one that is silent for longer counts as lost."""


class Group(Closing):
    """One rank's membership in a group; see `learner.algorithm.whole.Ranks`.

    Args:
        rank: of this process.
        size: number of all.
        meeting_place: a file that does not exist yet, of this group alone.
        device: where the tensors are.

    Raises:
        RanksError: not all ranks came.
    """

    def __init__(self, rank: int, size: int, meeting_place: Path, device: torch.device) -> None:
        # Imported here: one rank alone needs none of it.
        from torch import distributed

        self.rank, self.size = rank, size
        self._device = device
        self._distributed = distributed
        loopback = next((name for _, name in socket.if_nameindex() if name.startswith("lo")), None)
        if loopback is not None:
            os.environ.setdefault("GLOO_SOCKET_IFNAME", loopback)
            os.environ.setdefault("NCCL_SOCKET_IFNAME", loopback)
        # Without this NCCL ends the whole process, rank 0 with bus and journal, where gloo raises an error.
        os.environ.setdefault("TORCH_NCCL_BLOCKING_WAIT", "1")
        backend = "nccl" if device.type == "cuda" else "gloo"
        try:
            store = distributed.FileStore(str(meeting_place), size)  # type: ignore[attr-defined]
            store.set_timeout(timedelta(seconds=JOIN_SECONDS))
            distributed.init_process_group(
                backend, store=store, rank=rank, world_size=size, timeout=timedelta(seconds=STEP_SECONDS)
            )
            self.sum(torch.zeros(1, device=device))  # now all are known to be there
        except (RuntimeError, ValueError) as error:
            self.close()
            raise RanksError(f"rank {rank} of {size} could not join the others: {_first_sentence(error)}") from error

    def sum(self, values: Tensor) -> Tensor:
        """Return the sum of a tensor over all ranks; see `Ranks.sum`.

        Raises:
            RanksError: a rank is gone or silent.
        """
        summed = values.detach().to(self._device, copy=True)
        try:
            self._distributed.all_reduce(summed)
        except RuntimeError as error:
            raise RanksError(f"rank {self.rank} of {self.size} lost another: {_first_sentence(error)}") from error
        return summed.to(values.device)

    def close(self) -> None:
        """Leave the group; the others notice. Safe to call twice."""
        if self._distributed.is_initialized():
            with suppress(RuntimeError):
                self._distributed.destroy_process_group()


def _first_sentence(error: Exception) -> str:
    return str(error).split(". ", maxsplit=1)[0]


def rank_device(device: torch.device, rank: int, size: int) -> torch.device:
    """Return the device of one of several ranks: the CPU for all, or a CUDA device for each.

    Raises:
        ConfigError: there are not as many CUDA devices.
    """
    if device.type != "cuda" or size == 1:
        return device
    if device.index is not None:
        raise ConfigError(f"learner.device {device} is one device for {size} learners: use cuda, auto or cpu")
    present = torch.cuda.device_count()
    if present < size:
        raise ConfigError(
            f"{size} learners need {size} CUDA devices, this machine has {present}: use --learners {present}, or set "
            "learner.device to cpu"
        )
    return torch.device("cuda", rank)
