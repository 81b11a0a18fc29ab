"""Coverage-guided fuzzing of one reader; CONTRIBUTING.md says how to run it. Needs `pip install atheris`.

    python -m tests.fuzz.fuzz_readers ply corpus/ply -max_total_time=600

The first word is a target, the rest is libFuzzer's. Inputs are whole files; those of a folder come as a zip of it.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import sys
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from random import Random

import atheris

with atheris.instrument_imports(include=["tsplat.io", "PIL"]):
    from tests.io.containers import BROKEN
    from tests.io.honest_files import HONEST, Files, written
    from tests.io.mutants import mutant
    from tests.io.outcomes import OPTIONS, limited_growth, outcome, read_or_refused, within_memory
    from tests.io.side_files import SIDE, looked_at
    from tests.io.sogs import zipped
    from tsplat.io.on_disk import look
    from tsplat.io.sog_levels import open_levels
    from tsplat.io.sources import legible

TARGETS = {
    "ply": ("PLY", "PLY behind faces", "PLY, big-endian", "PLY, ASCII"),
    "ply-kinds": ("PLY of points", "PLY of points, ASCII", "PLY of halves", "PLY, renamed and filtered"),
    "colmap": ("COLMAP's points",),
    "colmap-text": ("COLMAP's points as text",),
    "gzip": ("PLY in gzip",),
    "compressed-ply": ("compressed PLY", "compressed PLY, old"),
    "splat": ("splat",),
    "ksplat": ("ksplat 0", "ksplat 1", "ksplat 2", "ksplat of GaussForge"),
    "spz": ("SPZ 1", "SPZ 2", "SPZ 3", "SPZ without gzip", "SPZ 4", "SPZ 4 of degree 0"),
    "glb": ("GLB", "GLB of SPZ"),
    "gltf": ("glTF",),
    "gltf-folder": ("glTF in a folder",),
    "npz": ("NumPy", "NumPy, deflated"),
    "sog": ("SOG", "SOG, deflated", "SOG 1"),
    "sog-folder": ("SOG in a folder", "SOG 1 in a folder"),
    "sog-streamed": ("SOG, streamed",),
    "sog-levels": ("SOG, streamed",),
    "cameras": ("cameras.json",),
    "transforms-png": ("transforms.json",),
    "transforms-jpeg": ("transforms.json of JPEG",),
    "transforms-webp": ("transforms.json of WebP",),
    "tsplat": ("tsplat",),
    "gsplat-png": ("gsplat PNG",),
    "zip": ("PLY in a zip", "SOG in a zip"),
}
"""Which honest files each target begins with; they lie in one kind of place, a file of one name or a folder."""

DEFAULTS = ("-timeout=10", "-rss_limit_mb=2048", "-max_len=32768", "-print_final_stats=1", "-detect_leaks=0")

ROOM_BYTES = 1 << 30
"""What the process may grow by: NumPy asks for memory that it never touches, which libFuzzer does not see."""

TRACED = 8
"""Of so many inputs the memory of one is measured: that takes three times as long."""


def _look_at_levels(path: Path) -> None:
    """Read a streamed scene as it is drawn, file by file, and what it takes on disk."""

    def read() -> None:
        look(path)
        with legible(path):
            levels = open_levels(path)
        for number in range(len(levels.counts)):
            levels.read(number, warn=True)

    read_or_refused(path, read)


OTHERWISE: dict[str, Callable[[Path], object]] = {
    "sog-levels": _look_at_levels,
    **{name: looked_at for name in TARGETS if name.startswith(("cameras", "transforms"))},
}
"""What looks at the files of targets that are not loaded as a scene."""


def main() -> None:
    name, *arguments = sys.argv[1:]
    seeds = [{**HONEST, **SIDE}[kind] for kind in TARGETS[name]]
    inputs = [_packed(files) for files in seeds]
    corpora = [Path(word) for word in arguments if not word.startswith("-") and not Path(word).is_file()]
    for raw in inputs if corpora else []:
        corpora[0].mkdir(parents=True, exist_ok=True)
        (corpora[0] / hashlib.sha1(raw).hexdigest()).write_bytes(raw)
    # Memory is where no disk is worn; a file's name is one of the honest ones, whatever the input says.
    folder = Path(tempfile.mkdtemp(prefix="fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None))

    def test_one(raw: bytes) -> None:
        files = _unpacked(raw, seeds[0])
        if files is not None:
            path, options = written(folder, files), OPTIONS[sum(raw) % len(OPTIONS)]
            if name in OTHERWISE:
                OTHERWISE[name](path)
            elif zlib.crc32(raw) % TRACED:
                outcome(path, **options)
            else:
                within_memory(path, 16 * len(raw), **options)

    def mutate(raw: bytes, most: int, seed: int) -> bytes:
        random = Random(seed)
        change = None if random.random() < 0.4 else lambda _, part, __: atheris.Mutate(part, most)
        return mutant(random, raw, inputs, change)[:most]

    atheris.Setup([sys.argv[0], *DEFAULTS, *arguments], test_one, custom_mutator=mutate)
    with limited_growth(ROOM_BYTES):
        atheris.Fuzz()


def _packed(files: Files) -> bytes:
    return zipped(files) if len(files) > 1 else next(iter(files.values()))


def _unpacked(raw: bytes, seed: Files) -> Files | None:
    if len(seed) == 1:
        return dict.fromkeys(seed, raw)
    with contextlib.suppress(*BROKEN), zipfile.ZipFile(io.BytesIO(raw)) as archive:
        return {name: archive.read(name) if name in archive.NameToInfo else b"" for name in seed}
    return None


if __name__ == "__main__":
    main()
