"""Matrix products of numpy on one core, where they are small and somebody waits for them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController


@cache
def _libraries() -> ThreadpoolController:
    """Return the libraries that multiply matrices in this process; numpy has loaded its own."""
    return ThreadpoolController().select(user_api="blas")


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Let matrix products take one thread; afterwards they take as many as before.

    A decision's products are small: two threads gain nothing on an idle machine, and on one whose cores are busy each
    product waits until all of its threads have had their turn (docs/design.md, "Memory and threads of the processes").
    """
    libraries = _libraries()
    if all(each.num_threads == 1 for each in libraries.lib_controllers):
        yield
        return
    with libraries.limit(limits=1):
        yield
