"""``python -m rodgen`` and ``rodgen``: the command line, of which no import can be interrupted with a traceback."""

import sys


def main() -> int:
    """Run the command line; return the exit code."""
    try:
        from rodgen.cli.main import main as run

        return run()
    except KeyboardInterrupt:  # while it is imported; later it is caught there
        print("rodgen: interrupted; no file was written", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
