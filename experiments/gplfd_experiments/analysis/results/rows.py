"""A row per task: the results of a study for other programs, as CSV or Parquet."""

import csv
import json
from pathlib import Path

from gplfd_experiments.analysis.results.records import StudyResults
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_policies.arrays.storage import complete_or_absent


def write_rows(path: Path, results: StudyResults) -> None:
    """Write fields and metrics of every task; None is empty, lists are JSON.

    Raises ValueError for another suffix, ModuleNotFoundError without pyarrow.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"{path} must end in .csv or .parquet")
    found = [
        {**one.task.definition, "error": one.error, "code": one.code, **one.metrics}
        for one in results.all
    ]
    columns = dict.fromkeys(name for row in found for name in row)
    plain = bool | int | float | str | None
    rows = [
        {n: v if isinstance(v := row.get(n), plain) else json.dumps(v) for n in columns}
        for row in found
    ]
    with complete_or_absent(path) as temporary:
        if path.suffix == ".csv":
            with temporary.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, columns)
                writer.writeheader()
                writer.writerows(rows)
        else:
            with optional_libraries("Parquet needs pyarrow", "lerobot"):
                import pyarrow.parquet
            pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), temporary)
