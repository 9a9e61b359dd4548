"""`python -m hdplanner` is `hdplanner`."""

from common.system.entry import ended_by_signals


def main() -> None:
    """Run the command; the entry point `hdplanner`."""
    with ended_by_signals():
        from hdplanner.cli import app

        app(prog_name="hdplanner")


if __name__ == "__main__":
    main()
