"""An X server without a monitor: its screen is a file to look into, its keyboard is xdotool's.

Reading the file asks nobody, so a test sees each state of the screen for as long as it lasts.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import numpy as np
import numpy.typing as npt

U8 = npt.NDArray[np.uint8]

WIDTH, HEIGHT = 1280, 800


class Display:
    """Start Xvfb under the first free display number.

    Parameters
    ----------
    folder : Path
        Where the file with the screen goes.

    Attributes
    ----------
    name : str
        What DISPLAY has to be.
    pixels : ndarray of uint8, [800, 1280, 3]
        The screen as it is now, red, green and blue; read-only, and it changes by itself.
    """

    def __init__(self, folder: Path) -> None:
        told, tells = os.pipe()
        command = ["Xvfb", "-displayfd", str(tells), "-screen", "0", f"{WIDTH}x{HEIGHT}x24", "-fbdir", str(folder)]
        self._process = subprocess.Popen(
            [*command, "-nolisten", "tcp", "-noreset", "-nocursor"], pass_fds=[tells], stderr=subprocess.DEVNULL
        )
        os.close(tells)
        with os.fdopen(told) as number:
            self.name = f":{number.readline().strip()}"
        self.pixels = _screen(folder / "Xvfb_screen0")

    def close(self) -> None:
        """End the server, and with it all that is shown on it."""
        self._process.terminate()
        self._process.wait()

    def do(self, *actions: str) -> str:
        """Have xdotool act as a person at this screen; return what it says."""
        environment = {"DISPLAY": self.name, "PATH": os.environ["PATH"]}
        done = subprocess.run(["xdotool", *actions], check=True, env=environment, capture_output=True, text=True)
        return done.stdout

    def window(self) -> str:
        """Return the number of the window on this screen, "" while there is none."""
        environment = {"DISPLAY": self.name, "PATH": os.environ["PATH"]}
        command = ["xdotool", "search", "--onlyvisible", "--maxdepth", "1", "--name", "."]
        found = subprocess.run(command, check=False, env=environment, capture_output=True, text=True).stdout
        return found.split()[-1] if found else ""


def _screen(path: Path) -> U8:
    """Return the pixels of a dump in the format of xwd, which has a header of big-endian words."""
    dump = np.memmap(path, np.uint8, "r")
    header = dump[:100].view(">u4")
    start = int(header[0] + 12 * header[19])  # the header, then a table of colours, 12 bytes each
    height, bytes_per_line = int(header[5]), int(header[12])
    lines = dump[start : start + height * bytes_per_line].reshape(height, bytes_per_line // 4, 4)
    return lines[:, : int(header[4]), 2::-1]
