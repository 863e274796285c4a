"""The command ``gplfd``: exit status 2 in the small installation, 130 after Ctrl-C."""

import atexit
import gc
import os
import signal
import sys


def main() -> int:
    """Run `gplfd_experiments.cli.main.main` and return the exit status."""
    for stream in filter(None, (sys.stdout, sys.stderr)):
        # An ASCII terminal gets escapes instead of an error.
        stream.reconfigure(errors="backslashreplace")
    # Collections of what imports make, and one at the end, take a sixth of a `run`.
    gc.set_threshold(100_000)
    atexit.register(gc.freeze)
    # `kill` and `timeout` end a study as Ctrl-C does: with its worker processes.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        from gplfd_experiments.cli.main import main as run

        status = run()
        if sys.stdout:
            sys.stdout.flush()
        return status
    except ModuleNotFoundError as error:
        if (error.name or "gplfd").startswith("gplfd"):
            raise
        print(
            f"gplfd: {error.name} is not installed. With NumPy and SciPy alone, agents "
            "run in Python and there are no commands; `pip install gplfd`, or `pip "
            "install .` in a checkout, installs all that they need",
            file=sys.stderr,
        )
        return 2
    except KeyboardInterrupt as interruption:
        parts = ("gplfd: interrupted", "finished files are kept", *interruption.args)
        print("; ".join(map(str, parts)), file=sys.stderr)
        return 130
    except BrokenPipeError:  # as in ``gplfd list | head``
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


if __name__ == "__main__":
    sys.exit(main())
