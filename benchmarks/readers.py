"""How fast every format is read and in how much memory, against the libraries that read it, in one run.

    python benchmarks/readers.py [--splats 1000000] [--rounds 5] [--formats spz,sog] [--folder FOLDER]

The scene is real splats, tiled, of SH degree 3, saved in every format that tsplat or gaussforge writes;
with --folder the files stay there for the next run. Each library reads in a process of its own, in turns, from the
page cache, and the shortest time counts, kernels compiled; the peak is that of the first thing that a new process
reads. What is not installed is left out: ``pip install gsply gaussforge plyfile imagecodecs``, ``npm install
@playcanvas/splat-transform`` (found on PATH, and timed from its start to its end).
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from tsplat.io import demo_path, load, save
from tsplat.scene import Gaussians

SCENES = Path(os.environ.get("TSPLAT_SCENES", Path(__file__).resolve().parents[2] / "shared" / "scenes"))
Answer = dict[str, Any]

OURS = "tsplat"
LIBRARIES = OURS, "gsply", "gaussforge", "plyfile"
SPLAT_TRANSFORM = "splat-transform"

SAVED = ("ply", "compressed.ply", "splat", "spz", "sog", "glb")
FORGED = {"ksplat": ("ksplat", 3), "v4.spz": ("spz", 4)}
"""What gaussforge writes: the format's name there, and the version of an SPZ."""

REST_SPREAD = 0.05
"""Of made-up harmonics, where there is no real scene of degree 3."""


def make_scene(count: int) -> Gaussians:
    """Return so many splats of SH degree 3: a real scene again and again, each copy beside the last."""
    playbot, yashica = SCENES / "ply/playbot_500k_sh2.ply", SCENES / "format_matrix/yashica.ply"
    scene = load(playbot if playbot.exists() else demo_path())
    copy, source = np.divmod(np.arange(count), len(scene))
    tiled = scene.take(source)
    means = tiled.means + np.array([1, 0, 0], np.float32) * copy[:, None] * np.ptp(scene.means[:, 0])
    sh = np.empty((count, 16, 3), np.float32)
    sh[:, 0] = tiled.sh[:, 0]
    if yashica.exists():
        rest = load(yashica).sh[:, 1:]
        sh[:, 1:] = rest[np.arange(count) % len(rest)]
    else:
        sh[:, 1:] = np.random.default_rng(0).normal(0.0, REST_SPREAD, (count, 15, 3))
    return Gaussians(means, tiled.quats, tiled.scales, tiled.opacities, sh)


def make_files(folder: Path, count: int, names: list[str]) -> dict[str, Path]:
    """Return the files of a scene by format, made where they are missing."""
    files = {name: folder / f"{count}.{name}" for name in names}
    missing = [name for name in names if not files[name].exists()]
    scene = make_scene(count) if set(missing) & set(SAVED) else None
    for name in missing:
        if scene and name in SAVED:
            save(files[name], scene)
    for name in set(missing) & set(FORGED):
        try:
            forge = importlib.import_module("gaussforge").GaussForge()
        except ImportError:
            del files[name]
            continue
        kind, version = FORGED[name]
        source = (folder / f"{count}.ply").read_bytes()
        files[name].write_bytes(forge.convert(source, "ply", kind, spz_version=version)["data"])
    return files


def reader(library: str) -> Callable[[Path], Any]:
    """Return what reads a file with a library; it raises where it cannot."""
    if library == OURS:
        return load
    module = importlib.import_module(library)
    if library == "gsply":
        special: dict[str, Callable[[str], Any]] = {".spz": module.read_spz, ".sog": module.sogread}
        return lambda path: special.get(path.suffix, module.plyread)(str(path))
    if library == "plyfile":

        def read_columns(path: Path) -> Any:
            if path.name.endswith("compressed.ply"):
                raise ValueError("reads words and decodes none")
            return np.array(module.PlyData.read(str(path))["vertex"].data)

        return read_columns
    forge = module.GaussForge()

    def read_forged(path: Path) -> Any:
        kind = "compressed.ply" if path.name.endswith("compressed.ply") else path.suffix[1:]
        read = forge.read(path.read_bytes(), kind)
        if read.get("error"):
            raise ValueError(read["error"])
        return read

    return read_forged


def work(library: str) -> None:
    """Read the files named on standard input, and answer with seconds and bytes at the peak."""
    warnings.simplefilter("ignore")
    read = reader(library)
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        path = Path(line.strip())
        Path("/proc/self/clear_refs").write_text("5")  # forgets the peak
        before = _resident("VmRSS")
        start = time.perf_counter()
        try:
            scene = read(path)
            answer: Answer = {"seconds": time.perf_counter() - start, "peak": _resident("VmHWM") - before}
            del scene
        except Exception as error:  # noqa: BLE001 - whatever a library throws is its answer
            answer = {"error": repr(error)}
        print(json.dumps(answer), flush=True)


def _resident(field: str) -> int:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(field):
            return 1024 * int(line.split()[1])
    raise AssertionError(field)


class Worker:
    """A library in a process of its own."""

    def __init__(self, library: str) -> None:
        command = [sys.executable, __file__, "--worker", library]
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
        )
        self.there = bool(self._answer())

    def read(self, path: Path) -> Answer:
        """Return seconds and peak, or an error."""
        assert self._process.stdin
        self._process.stdin.write(f"{path}\n")
        self._process.stdin.flush()
        return self._answer() or {"error": "the process ended"}

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait()

    def _answer(self) -> Answer:
        assert self._process.stdout
        for line in self._process.stdout:
            if line.startswith("{"):
                answer: Answer = json.loads(line)
                return answer
        return {}


class SplatTransform:
    """PlayCanvas' program, from its start to its end."""

    there = shutil.which(SPLAT_TRANSFORM) is not None

    def read(self, path: Path) -> Answer:
        """Return seconds, or an error."""
        start = time.perf_counter()
        ended = subprocess.run([SPLAT_TRANSFORM, "-q", str(path), "null"], capture_output=True, check=False)
        return {"error": "failed"} if ended.returncode else {"seconds": time.perf_counter() - start}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--splats", type=int, default=1_000_000)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--formats", default=",".join([*SAVED, *FORGED]))
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--worker", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        work(options.worker)
        return
    # In a process of its own, so that Numba is in none that reads; others compile in their first reads, uncounted.
    subprocess.run([sys.executable, "-c", "from tsplat.decode import make_ready; make_ready()"], check=True)
    with tempfile.TemporaryDirectory() as temporary:
        files = make_files(options.folder or Path(temporary), options.splats, options.formats.split(","))
        readers: dict[str, Worker | SplatTransform] = {name: Worker(name) for name in LIBRARIES}
        readers[SPLAT_TRANSFORM] = SplatTransform()
        readers = {name: each for name, each in readers.items() if each.there}
        answers: dict[tuple[str, str], list[Answer]] = {(kind, name): [] for kind in files for name in readers}
        for _ in range(options.rounds):
            for (kind, name), found in answers.items():
                if not found or "error" not in found[0]:
                    found.append(readers[name].read(files[kind]))
        for (kind, name), found in answers.items():
            if name != SPLAT_TRANSFORM and "error" not in found[0]:
                fresh = Worker(name)
                found[0]["peak"] = fresh.read(files[kind])["peak"]
                fresh.close()
        _print(files, answers, options.splats)


def _print(files: dict[str, Path], answers: dict[tuple[str, str], list[Answer]], count: int) -> None:
    table = Table("format", "MB", "reader", "seconds", "times tsplat's", "peak / result")
    console = Console(width=None if sys.stdout.isatty() else 110)
    for (kind, name), found in answers.items():
        size = f"{files[kind].stat().st_size / 1e6:.1f}" if name == OURS else ""
        if "error" in found[0]:
            continue
        seconds = min(each["seconds"] for each in found)
        ours = min(each["seconds"] for each in answers[kind, OURS])
        result = 4 * count * (14 if kind == "splat" else 59)
        peak = f"{found[0]['peak'] / result:.2f}" if "peak" in found[0] else ""
        table.add_row(kind if size else "", size, name, f"{seconds:.2f}", f"{seconds / ours:.2f}", peak)
    console.print(table)
    console.print("load " + " ".join(f"{each:.1f}" for each in os.getloadavg()))


if __name__ == "__main__":
    main()
