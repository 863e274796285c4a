"""``gplfd speed``: how fast and how accurate, beside other libraries."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from experiments.commands.complaint import complain

if TYPE_CHECKING:
    from experiments.benchmarks.report import Result
    from policies.demonstrations import Demonstration

RESULTS = "speed.json"

PartName = Literal[
    "fit", "scaling", "predict", "adapt", "align", "environment", "accuracy"
]


@dataclass(frozen=True, kw_only=True, slots=True)
class Speed:
    """Measure speed and accuracy of policies and environment; minutes for everything.

    Prints tables and writes DIR/speed.json. Times are CPU times with one BLAS thread;
    what is compared runs in turns, in one process. Other libraries come with
    pip install 'gplfd[bench]'; without them their lines say "not installed".
    """

    only: tuple[PartName, ...] = ()
    """Parts to run; all by default."""

    repeats: int = 5
    """Measurements of every time, and draws of random data, 1 or more."""

    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Also score these recorded demonstrations, each left out once: an .npz file of
    this project, or an .npy array (demonstrations, samples, 7) of positions and
    quaternions."""

    unit: Literal["m", "cm", "mm"] = "m"
    """Unit of the positions of an .npy array."""

    quaternions: Literal["wxyz", "xyzw"] = "wxyz"
    """Order of the quaternions of an .npy array."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/speed")
    """Folder to write to."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from threadpoolctl import threadpool_limits

        from experiments.benchmarks.report import target_table
        from experiments.files.plain_data import write_json

        try:
            recordings = self._check()
        except (ValueError, OSError) as error:
            return complain(error)
        with threadpool_limits(1):
            results = self._measure(recordings)
            record = _record(self, results)
        targets = [target for result in results.values() for target in result.targets()]
        if targets:
            print(target_table(targets))
        try:
            write_json(self.out / RESULTS, record)
        except OSError as error:
            return complain(error)
        return 0

    def _check(self) -> tuple[Demonstration, ...] | None:
        """Check all arguments and read the recordings, before anything slow.

        Raises:
            ValueError: An argument is wrong, or a part asked for lacks a library.
            OSError: The recordings cannot be read.
        """
        from experiments.benchmarks.parts import PARTS
        from experiments.benchmarks.peers import require
        from experiments.benchmarks.recorded import load_recordings

        if self.repeats < 1:
            raise ValueError(f"--repeats {self.repeats} must be 1 or more")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file; give a folder")
        for name in self.only:
            require(PARTS[name].needs)
        if self.demonstrations is None:
            return None
        return load_recordings(self.demonstrations, self.unit, self.quaternions)

    def _measure(
        self, recordings: tuple[Demonstration, ...] | None
    ) -> dict[str, Result]:
        from experiments.benchmarks.parts import PARTS
        from experiments.benchmarks.recorded import score_recordings

        results: dict[str, Result] = {}
        for name in PARTS:
            if self.only and name not in self.only:
                continue
            for what, measure in PARTS[name].measures.items():
                print(f"measuring: {what}", file=sys.stderr, flush=True)
                results[what] = measure(self.repeats)
                _show(results[what])
        if recordings is not None:
            results["recorded"] = score_recordings(recordings, str(self.demonstrations))
            _show(results["recorded"])
        return results


def _show(result: Result) -> None:
    for table in result.tables():
        print(f"{table}\n", flush=True)


def _record(speed: Speed, results: Mapping[str, Result]) -> dict[str, Any]:
    """Everything measured, and where; JSON-able."""
    from experiments.benchmarks.machine import machine
    from experiments.files.provenance import provenance

    settings = dataclasses.asdict(speed) | {
        "out": str(speed.out),
        "demonstrations": str(speed.demonstrations) if speed.demonstrations else None,
    }
    return provenance(settings) | {
        "measured_on": machine(),
        "results": {
            name: dataclasses.asdict(result)  # type: ignore[call-overload]
            for name, result in results.items()
        },
        "targets": [
            dataclasses.asdict(target) | {"met": target.met}
            for result in results.values()
            for target in result.targets()
        ],
    }
