"""`python -m deploy` is `hd-deploy`."""

from common.system.entry import ended_by_signals


def main() -> None:
    """Run the command; the entry point `hd-deploy`."""
    with ended_by_signals():
        from deploy.cli import main as run

        run()


if __name__ == "__main__":
    main()
