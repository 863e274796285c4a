"""The command that makes a gallery: films of episodes in a web page."""

from dataclasses import dataclass
from pathlib import Path

from gplfd_experiments.cli.commands.options import Quiet, recorded
from gplfd_experiments.cli.commands.run import draw_without_screen
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Gallery:
    """Film episodes, and show two policies side by side in a web page.

    Writes DIR/index.html, DIR/episodes.js (numbers, curves, versions, settings) and a
    film per episode. The page needs neither a server nor a network. The same command
    continues what was interrupted; other doors, policies and seeds are added. Needs
    pip install 'gplfd[video]'.
    """

    doors: tuple[str, ...] = ()
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters; all of `gplfd list` by default."""

    policies: tuple[str, ...] = (
        *("gp", "gp-paper", "promp", "prodmp", "dmp", "gmr", "kmp", "gmm-gp"),
        *("hinge-fit", "mechanism-fit", "oracle"),
    )
    """Policies to use: names from `gplfd list`, or module:function of your own."""

    seed: int = 0
    """Seed of teacher, policy and environment, 0 or more."""

    out: Path = Path("results/gallery")
    """Folder to write to."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Run and film the episodes that are not there yet."""
        draw_without_screen()
        with postponed_interruption():
            from gplfd_experiments.workflows.gallery import PAGE, write_gallery

        number = write_gallery(
            self.doors, self.policies, self.out, seed=self.seed, options=recorded(self)
        )
        print(f"{number} episodes, look at them in a browser: {self.out / PAGE}")
        return 0
