"""The command `hdplanner`: which version this is, and what it can use."""

from __future__ import annotations

import sys

from common.cli import CommandApp, add_version, command_errors
from common.errors import HDError
from common.extensions import GENERATORS, SIMULATORS
from common.planners.registry import PLANNERS
from common.tasks import TASKS

app = CommandApp(
    name="hdplanner",
    help="HDPlanner's version and parts. The work is done by `hd-learner`, `hd-actor`, `hd-eval` and `hd-deploy`.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
add_version(app)


@app.command()
@command_errors
def parts() -> None:
    """List the planners, simulators, tasks and generators by name, those of installed packages too.

    Example: `hdplanner parts`
    """
    for registry in (PLANNERS, SIMULATORS, TASKS, GENERATORS):
        sys.stdout.write(f"{registry.word}s\n")
        for name in registry.names():
            try:
                summary = registry.summary(name)
            except HDError as error:
                # The others are worth listing all the same.
                summary = f"unusable: {error}"
            sys.stdout.write(f"  {name:18} {summary}\n")


if __name__ == "__main__":
    app()
