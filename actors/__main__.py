"""`python -m actors` is `hd-actor`."""

from actors.cli import app

if __name__ == "__main__":
    app(prog_name="hd-actor")
