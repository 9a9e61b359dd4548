"""Runs a command that ends with the process that started it, even when that process is killed.

Used as ``python -m common.system.tethered PARENT COMMAND...``: asks Linux for a SIGTERM at the parent's death and
becomes the command. The request survives the exchange of the program.
"""

from __future__ import annotations

import os
import sys

from common.system.signals import terminate_with_parent


def main(arguments: list[str]) -> None:
    """Tie this process to its parent and become the command."""
    parent, *command = arguments
    terminate_with_parent()
    if os.getppid() != int(parent):  # it died before we asked
        return
    os.execv(command[0], command)


if __name__ == "__main__":
    main(sys.argv[1:])
