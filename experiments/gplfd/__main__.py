"""The command ``gplfd``: exit status 2 in the small installation, 130 after Ctrl-C."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # ``-m`` searches the working folder first, which may hold a random.py.
    sys.path.pop(0)

import os


def main() -> int:
    """Run `gplfd_experiments.cli.main.main` and return the exit status."""
    utf8 = {**os.environ, "PYTHONUTF8": "1"}
    if sys.getfilesystemencoding() != "utf-8" and os.environ != utf8:
        # In an ASCII locale, names of files could not be stored and read again.
        os.execve(sys.executable, sys.orig_argv, utf8)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # closed, as in ``gplfd list >&-``
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115
        # An ASCII terminal gets escapes instead of an error.
        getattr(sys, name).reconfigure(errors="backslashreplace")
    try:
        from gplfd_experiments.cli.main import main as run

        status = run()
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
