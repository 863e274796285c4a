"""Ctrl-C comes when it may, and to this process only."""

import signal
import subprocess
import sys

from gplfd_experiments.console.interruption import postponed_interruption


def test_an_interruption_waits_until_the_block_ends():
    """In a process without other threads, as the command is when it imports."""
    program = (
        "import os, signal\n"
        "from gplfd_experiments.console.interruption import postponed_interruption\n"
        # A shell lets what it starts in the background ignore Ctrl-C.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "try:\n"
        "    with postponed_interruption():\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "        print('reached')\n"
        "    print('too far')\n"
        "except KeyboardInterrupt:\n"
        "    print('interrupted')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, check=True
    )
    assert ended.stdout.split() == [b"reached", b"interrupted"]


def test_what_starts_in_the_block_is_not_interrupted():
    """And afterwards, all is as before."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    program = "import os, signal; os.kill(os.getpid(), signal.SIGINT); print('on')"
    with postponed_interruption(), postponed_interruption():
        ended = subprocess.run(
            [sys.executable, "-c", program], capture_output=True, check=False
        )
    assert (ended.returncode, ended.stdout) == (0, b"on\n")
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == before
