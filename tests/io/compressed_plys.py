"""Compressed PLY files made by hand for the tests, a slow reader, and how near two scenes must be."""

from __future__ import annotations

import math
import struct

import numpy as np

from tests.io.plys import STRUCT_CODES, Table
from tsplat.camera import Camera
from tsplat.framing import start_pose
from tsplat.scene import Gaussians

BOUNDS = [f"{end}_{of}" for end in ("min", "max") for of in ("x", "y", "z")]
SCALE_BOUNDS = [f"{end}_scale_{of}" for end in ("min", "max") for of in ("x", "y", "z")]
COLOR_BOUNDS = [f"{end}_{of}" for end in ("min", "max") for of in ("r", "g", "b")]
WORDS = ["packed_position", "packed_rotation", "packed_scale", "packed_color"]
FIELDS = ("means", "quats", "scales", "opacities", "sh")


def tables(
    chunks: list[list[float]], words: list[list[int]], rest: list[list[int]] | None = None, colors: bool = True
) -> list[Table]:
    names = [*BOUNDS, *SCALE_BOUNDS, *(COLOR_BOUNDS if colors else [])]
    found = [
        Table("chunk", [("float", name) for name in names], chunks),
        Table("vertex", [("uint", name) for name in WORDS], words),
    ]
    if rest is not None:
        found.append(Table("sh", [("uchar", f"f_rest_{i}") for i in range(len(rest[0]))], rest))
    return found


def small_tables(sh_degree: int = 1, count: int = 3, colors: bool = True) -> list[Table]:
    """Return a scene of any words at all, in chunks whose bounds differ."""
    rng = np.random.default_rng(count)
    chunks = [
        [*(-1.0 - i, 0.0, 2.0, 1.0 + i, 0.5, 2.0), *(-6.0, -5.0, -4.0 - i, -1.0, -2.0, -3.0)]
        + ([-0.5 - i, 0.0, 0.25, 1.5, 1.0, 0.75 + i] if colors else [])
        for i in range(-(-count // 256))
    ]
    words = rng.integers(0, 2**32, (count, 4)).tolist()
    rest = rng.integers(0, 256, (count, 3 * ((sh_degree + 1) ** 2 - 1))).tolist() if sh_degree else None
    return tables(chunks, words, rest, colors)


def bits(word: int, shift: int, count: int) -> float:
    top = (1 << count) - 1
    return (word >> shift & top) / top


def slow_splat(chunk: list[float], words: list[int], rest: list[int]) -> dict[str, list[float]]:
    """Return what one splat means, a number at a time."""
    position, rotation, scale, color = words
    bounds = chunk if len(chunk) == 18 else [*chunk, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0]
    places = ((21, 11), (11, 10), (0, 11))

    def within(start: int, parts: list[float]) -> list[float]:
        return [
            bounds[start + i] + (bounds[start + 3 + i] - bounds[start + i]) * part for i, part in enumerate(parts)
        ]

    quat = [(bits(rotation, shift, 10) - 0.5) * math.sqrt(2.0) for shift in (20, 10, 0)]
    quat.insert(rotation >> 30, math.sqrt(max(0.0, 1.0 - sum(q * q for q in quat))))
    length = math.sqrt(sum(q * q for q in quat))
    sh = [(each - 0.5) / 0.28209479177387814 for each in within(12, [bits(color, s, 8) for s in (24, 16, 8)])]
    for i in range(len(rest) // 3):
        for step in (rest[i], rest[len(rest) // 3 + i], rest[2 * len(rest) // 3 + i]):
            sh.append({0: -4.0, 255: 4.0}.get(step, (step + 0.5) / 32 - 4.0))
    return {
        "means": within(0, [bits(position, *place) for place in places]),
        "quats": [q / length for q in quat],
        "scales": [math.exp(each) for each in within(6, [bits(scale, *place) for place in places])],
        "opacities": [bits(color, 0, 8)],
        "sh": sh,
    }


def check(gaussians: Gaussians, elements: list[Table]) -> None:
    chunk, vertex, *rest = elements
    assert len(gaussians) == len(vertex.rows)
    for index, words in enumerate(vertex.rows):
        steps = list(rest[0].rows[index]) if rest else []
        for name, values in slow_splat(list(chunk.rows[index // 256]), list(words), steps).items():
            np.testing.assert_allclose(np.ravel(getattr(gaussians, name)[index]), values, 1e-5, 2e-6, err_msg=name)


def read_tables(raw: bytes) -> list[Table]:
    """Return the elements of a little-endian file, a number at a time."""
    head, body = raw.split(b"end_header\n", 1)
    found: list[Table] = []
    for line in head.decode("latin-1").splitlines():
        match line.split():
            case ["element", name, count]:
                found.append(Table(name, [], [[]] * int(count)))
            case ["property", *scalar, name]:
                found[-1].columns = [*found[-1].columns, (" ".join(scalar), name)]
    at = 0
    for table in found:
        forms = [[STRUCT_CODES[word] for word in scalar.split() if word != "list"] for scalar, _ in table.columns]
        plain = "<" + "".join(form[0] for form in forms)
        lists = any(len(form) > 1 for form in forms)
        rows = []
        for _ in table.rows:
            row, at = _row(body, at, forms) if lists else (list(struct.unpack_from(plain, body, at)), at)
            at += 0 if lists else struct.calcsize(plain)
            rows.append(row)
        table.rows = rows
    assert at == len(body)
    return found


def _row(body: bytes, at: int, forms: list[list[str]]) -> tuple[list[object], int]:
    row: list[object] = []
    for length, *item in forms:
        (value,) = struct.unpack_from("<" + length, body, at)
        at += struct.calcsize("<" + length)
        if item:
            form = f"<{value}{item[0]}"
            value, at = [*struct.unpack_from(form, body, at)], at + struct.calcsize(form)
        row.append(value)
    return row, at


def matched(truth: Gaussians, found: Gaussians) -> Gaussians:
    """Return the splats of ``truth`` in the order of ``found``, whose order a writer changed."""
    ours, theirs = (_features(gaussians) for gaussians in (truth, found))
    lengths = (ours * ours).sum(1)
    nearest = [
        (lengths - 2.0 * theirs[first : first + 256] @ ours.T).argmin(1) for first in range(0, len(theirs), 256)
    ]
    truth_from_found = np.concatenate(nearest)
    assert len(set(truth_from_found.tolist())) == len(found), "each splat has its own twin"
    return truth.take(truth_from_found)


def _features(gaussians: Gaussians) -> np.ndarray:
    # Means alone would confuse splats that lie within a step of each other.
    means = (gaussians.means - np.array([0.3, 0.0, 0.0])).astype(np.float64)
    return np.concatenate([means, 0.02 * np.log(gaussians.scales + 1e-9), 0.1 * gaussians.sh[:, 0]], axis=1)


def assert_within_a_step(truth: Gaussians, found: Gaussians) -> None:
    """Require that every value of ``found`` is the nearest its file could hold: half a step off at most."""
    for values, twins, steps in (
        (truth.means, found.means, (2047, 1023, 2047)),
        (np.log(truth.scales), np.log(found.scales), (2047, 1023, 2047)),
        (truth.sh[:, 0], found.sh[:, 0], (255, 255, 255)),
    ):
        for first in range(0, len(found), 256):
            part = twins[first : first + 256]
            step = (part.max(0) - part.min(0)) / steps
            assert np.all(np.abs(values[first : first + 256] - part) <= 0.51 * step + 1e-5)
    assert np.abs(truth.opacities - found.opacities).max() <= 0.501 / 255
    assert np.all(np.abs(truth.sh[:, 1:] - found.sh[:, 1:]) <= 1.001 / 64)
    signs = np.sign(np.einsum("ij,ij->i", truth.quats, found.quats))[:, None]
    # Half a step of sqrt(2) / 1023 in each of three; what follows from them is off by as much as all together.
    assert np.abs(truth.quats * signs - found.quats).max() <= 1.5 * math.sqrt(2.0) / 1023


def start_camera(gaussians: Gaussians) -> Camera:
    return start_pose(gaussians, aspect=320 / 180, fov_y=50.0).camera(width=320, height=180, fov_y=50.0)
