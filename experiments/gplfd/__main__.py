"""The command ``gplfd``: exit status 130 after Ctrl-C, 141 without a reader."""

import os
import sys


def main() -> int:
    """Run `gplfd_experiments.cli.main.main` and return the exit status."""
    try:
        from gplfd_experiments.cli.main import main as run

        status = run()
        sys.stdout.flush()
        return status
    except KeyboardInterrupt as interruption:
        parts = ("gplfd: interrupted", "finished files are kept", *interruption.args)
        print("; ".join(map(str, parts)), file=sys.stderr)
        return 130
    except BrokenPipeError:  # as in ``gplfd list | head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


if __name__ == "__main__":
    sys.exit(main())
