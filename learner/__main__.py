"""`python -m learner` is `hd-learner`."""

from common.system.entry import ended_by_signals


def main() -> None:
    """Run the command; the entry point `hd-learner`."""
    with ended_by_signals():
        from learner.cli import app

        app(prog_name="hd-learner")


if __name__ == "__main__":
    main()
