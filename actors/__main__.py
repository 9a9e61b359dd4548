"""`python -m actors` is `hd-actor`."""

from common.system.entry import ended_by_signals


def main() -> None:
    """Run the command; the entry point `hd-actor`."""
    with ended_by_signals():
        from actors.cli import app

        app(prog_name="hd-actor")


if __name__ == "__main__":
    main()
