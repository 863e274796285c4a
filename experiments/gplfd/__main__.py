"""The command ``gplfd``: the process around `gplfd_experiments.cli.main`.

Users' folders may contain files called ``random.py``, ``json.py`` or ``numpy.py``. If
such a folder is searched first, as with ``PYTHONPATH=.``, only a module with a unique
name is found reliably: this one. Run as the command, it corrects the search path for
all other modules.
"""

import io
import os
import sys

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 and the number of the signal."""

BAD_INPUT = 2
"""Exit status if a requirement of the commands is not installed."""

PIPE_CLOSED = 141
"""Exit status if the reader of the output closed the pipe, as in ``gplfd list |
head``."""


def _search_installed_first() -> None:
    """Search the standard library, our packages and installed ones before the rest.

    Entries before the standard library in ``sys.path`` come from the user:
    ``PYTHONPATH`` and the folder of the script or, after ``python -m``, the working
    folder. The working folder is not searched at all: dependencies look for optional
    modules, such as ``org`` and ``uarray``, and would run a user's file of that name.
    The folder of a policy is searched while the policy is imported
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
    """Replace a user's module by the standard one in modules that imported it already.

    The script that pip writes imports ``re`` before this module and uses it afterwards.
    """
    impostor = sys.modules.pop(name)
    vars(impostor).update(vars(__import__(name)))


# Not in `main`, because that script uses ``re`` before it calls `main`.
_search_installed_first()


def main() -> int:
    """Run the command.

    Returns:
        The status of `gplfd_experiments.cli.main.main`, `BAD_INPUT`, `INTERRUPTED` or
        `PIPE_CLOSED`.
    """
    # After the search path is corrected: a user's folder may have a ``signal.py``.
    import faulthandler
    import signal
    from typing import Any

    # After a crash in C, for example in a user's policy, print the Python line.
    faulthandler.enable(all_threads=False)

    interrupted = False
    message = "gplfd: interrupted; files already written are complete"
    exit_at_once = os._exit

    def interrupt(*_: Any) -> None:
        """Raise; the second Ctrl-C also ends a policy that catches every exception."""
        nonlocal interrupted
        if interrupted:
            try:
                # A write to `sys.stderr` may be in progress; it is not reentrant.
                os.write(2, f"{message}\n".encode())
            finally:
                exit_at_once(INTERRUPTED)
        interrupted = True
        raise KeyboardInterrupt

    def raise_again(*_: Any) -> None:
        raise KeyboardInterrupt

    def interrupt_again(lost: Any) -> None:
        """Repeat an interruption in a callback from C, which cannot raise."""
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
    # Any error after an interruption is caused by it: libraries in C report
    # interruptions in different ways.
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
    # Workers and other child processes use the same search path, without the working
    # folder.
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
        # Discard the rest of the buffer, or Python reports an error at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED


if __name__ == "__main__":
    sys.exit(main())
