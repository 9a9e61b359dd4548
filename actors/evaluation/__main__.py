"""`python -m actors.evaluation` is `hd-eval`."""

from common.system.entry import ended_by_signals


def main() -> None:
    """Run the command; the entry point `hd-eval`."""
    with ended_by_signals():
        from actors.evaluation.cli import app

        app(prog_name="hd-eval")


if __name__ == "__main__":
    main()
