"""Compare the lines of every folder with its ceiling: python .ci/ceilings.py.

The ceilings stand in ceilings.toml beside this file. `--lower` writes the present
numbers where they are below; nothing here raises a ceiling.
"""

import subprocess
import sys
import tomllib
from pathlib import Path

FILE = Path(__file__).with_name("ceilings.toml")
ROOT = FILE.parents[1]


def lines_of(folder: str) -> int:
    """Return the number of lines of all Python files that belong to a folder."""
    files = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", f"{folder}/**.py"],
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    ).stdout.splitlines()
    paths = [ROOT / file for file in files]
    return sum(path.read_bytes().count(b"\n") for path in paths if path.exists())


def main() -> int:
    """Print the lines of each folder; return 1 if one is above its ceiling."""
    ceilings: dict[str, int] = tomllib.loads(FILE.read_text())
    lines = {folder: lines_of(folder) for folder in ceilings}
    for folder, ceiling in ceilings.items():
        print(f"{folder:<12} {lines[folder]:>6} lines, ceiling {ceiling}")
    if "--lower" in sys.argv[1:]:
        comment = [line for line in FILE.read_text().splitlines() if line[:1] == "#"]
        lower = [f"{name} = {min(lines[name], ceilings[name])}" for name in ceilings]
        FILE.write_text("\n".join([*comment, *lower, ""]))
    above = [name for name, ceiling in ceilings.items() if lines[name] > ceiling]
    if above:
        print(f"above the ceiling: {', '.join(above)}; remove what is superfluous")
    return int(bool(above))


if __name__ == "__main__":
    sys.exit(main())
