"""One process that runs notebooks, one after the other; see `run_notebook`."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parent / "run_notebook.py"


class NotebookRunner:
    """Starts the process, and starts it anew after one that has failed to answer.

    Args:
        folder: where the notebooks lie.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self.process: subprocess.Popen[str] | None = None

    def run(self, name: str) -> dict[str, str]:
        """Run a notebook's script; return what it has printed, and why it failed."""
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        process = self.process or subprocess.Popen([sys.executable, str(SCRIPT)], cwd=self.folder, text=True, **pipes)
        self.process = process
        try:
            process.stdin.write(f"{name}\n")
            process.stdin.flush()
            return json.loads(process.stdout.readline())
        except BaseException:  # a test that takes too long, too
            self.stop()
            raise

    def stop(self) -> None:
        """End the process."""
        if self.process:
            self.process.kill()
            self.process.communicate()
        self.process = None
