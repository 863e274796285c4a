"""The command ``gplfd``: the process around `gplfd_experiments.cli.main`.

Users' folders have files called ``random.py``, ``json.py`` or ``numpy.py``. Where such
a folder is searched first, as with ``PYTHONPATH=.``, only a module whose name nobody
else uses is found for certain: this one. Run as the command, it puts the search for all
others in order.
"""

import io
import os
import sys

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of the signal."""

BAD_INPUT = 2
"""Exit status where a requirement of the commands is not installed."""

PIPE_CLOSED = 141
"""Exit status when the reader of the output has gone, as in ``gplfd list | head``."""


def _search_installed_first() -> None:
    """Search the standard library, our packages and installed ones before the rest.

    What stands before the standard library in ``sys.path`` is the user's:
    ``PYTHONPATH`` and the folder of the script or, after ``python -m``, the working
    folder. The working folder is not searched at all: dependencies look for optional
    modules, such as ``org`` and ``uarray``, and would run a user's file of that name.
    A policy's own folder is searched while the policy is imported
    (`gplfd_policies.registry.user_policies`).
    """
    library = os.path.dirname(os.__file__)
    if library not in sys.path:
        return
    first = sys.path.index(library)
    home = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    users = sys.path[:first]
    by_module = __name__ == "__main__" and not sys.flags.safe_path
    searched = users[1:] if by_module else users
    sys.path[:] = dict.fromkeys((library, home, *sys.path[first:], *searched))
    for folder in users:
        for name in sys.stdlib_module_names.intersection(sys.modules):
            if getattr(sys.modules[name], "__file__", None) in (
                os.path.join(folder or os.getcwd(), f"{name}.py"),
                os.path.join(folder or os.getcwd(), name, "__init__.py"),
            ):
                _replace(name)


def _replace(name: str) -> None:
    """Put a standard module in the place of a user's, for those who have it already.

    The script that pip writes imports ``re`` before this module, and uses it after.
    """
    impostor = sys.modules.pop(name)
    vars(impostor).update(vars(__import__(name)))


# Not in `main`, for the sake of that script.
_search_installed_first()


def main() -> int:
    """Run the command.

    Returns:
        The status of `gplfd_experiments.cli.main.main`, `BAD_INPUT`, `INTERRUPTED` or
        `PIPE_CLOSED`.
    """
    # After the search was put in order: a user's folder may have a ``signal.py``.
    import faulthandler
    import signal
    from typing import Any

    # A crash in C, perhaps of a user's policy, says in which line of Python it was.
    faulthandler.enable(all_threads=False)

    interrupted = False
    message = "gplfd: interrupted; files already written are complete"
    exit_at_once = os._exit

    def interrupt(*_: Any) -> None:
        """Raise; the second Ctrl-C ends a policy that catches every exception."""
        nonlocal interrupted
        if interrupted:
            try:
                # `sys.stderr` may be amid a write, and cannot be entered again.
                os.write(2, f"{message}\n".encode())
            finally:
                exit_at_once(INTERRUPTED)
        interrupted = True
        raise KeyboardInterrupt

    def raise_again(*_: Any) -> None:
        raise KeyboardInterrupt

    def interrupt_again(lost: Any) -> None:
        """Repeat an interruption that hit a callback from C, which cannot raise."""
        if issubclass(lost.exc_type, KeyboardInterrupt):
            signal.setitimer(signal.ITIMER_REAL, 0.1)
        else:
            sys.__unraisablehook__(lost)

    signal.signal(signal.SIGINT, interrupt)
    if sys.platform != "win32":
        signal.signal(signal.SIGALRM, raise_again)
        sys.unraisablehook = interrupt_again
    try:
        status = _run()
    # Whatever comes after an interruption comes of it: libraries in C report it in ways
    # of their own.
    except BaseException:
        if not interrupted:
            raise
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if interrupted:
        print(message, file=sys.stderr)
        return INTERRUPTED
    return status


def _run() -> int:
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that knows only ASCII shows a question mark for a degree sign.
            stream.reconfigure(errors="replace")
    # For workers and all other children: they search as this process does, without the
    # working folder.
    os.environ |= {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    from gplfd_experiments.console.interruption import postponed_interruption

    try:
        with postponed_interruption():
            from gplfd_experiments.cli import main as cli
    except ModuleNotFoundError as error:
        if (error.name or "gplfd").startswith("gplfd"):
            raise
        print(
            f"gplfd: {error.name} is not installed. With NumPy and SciPy alone, the "
            "small installation, agents run in Python and there are no commands; "
            "`pip install gplfd`, or `pip install .` in a checkout, installs all that "
            "they need",
            file=sys.stderr,
        )
        return BAD_INPUT
    try:
        try:
            return cli.main()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # What is left in the buffer goes nowhere, or Python would complain at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED


if __name__ == "__main__":
    sys.exit(main())
