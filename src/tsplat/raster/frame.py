"""Everything one frame reads and writes, as the stages see it: plain arrays and numbers, for all workers alike."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from tsplat import _threads
from tsplat._arguments import known
from tsplat._bits import BATCH
from tsplat.camera import Camera
from tsplat.raster.cells import CELLS, TILE
from tsplat.raster.prepare import BLOCK, Prepared
from tsplat.raster.record import LENGTH
from tsplat.raster.train_depths import train_depths_of
from tsplat.rendering import JACOBIAN_LIMIT, RenderOptions

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

NEXT_BLOCK, NEXT_TILE = _threads.FIRST_FREE, _threads.FIRST_FREE + 8
"""Counters of the team: the work that nobody has taken yet."""

COUNTERS = 2

CACHES = 12 << 20
"""Bytes of records, or of an image, that are not expected to be found again in any cache."""

PIXEL = 16
"""Bytes of a pixel's colours and alpha."""

SORT_BITS = 9
"""Of a depth, in the first two passes of the sort: these write to so few places at a time that the first-level
cache holds them."""

HIGH_BUCKETS = 1 << (32 - 2 * SORT_BITS)
"""Of the last pass."""

KEY_SHIFT = 26
"""Low bits of a float64 depth that are not in its key. So a key has three more than float32 has, whose rounding
shows on moving walls, and 64 doublings of the near plane fit into 32 bits."""

SPLAT_BYTES = 4 * LENGTH + 4 + 8 + 8 + 4 + 8
"""Of a frame for each splat of its blocks: a record, its key, and by what it is sorted and listed."""

PAIR_BYTES = 4
"""Of a frame for each pair of a tile and a splat."""

SCRATCH_ROWS = 22
SCRATCH = SCRATCH_ROWS * BLOCK
"""float32 values of a worker's own memory; project and composite use it in turn, in the first-level cache."""

SLACK = 64
"""Entries behind the last one that are read ahead, never drawn; in ``isect_ids`` they are zero."""

BLENDS, VISIBLE, LOWEST, HIGHEST = range(4)
"""Columns of ``results``: cells blended by this worker, records of all, the range of the high bits of this
worker's depths."""

NONE = np.empty(0, np.float32)
"""In place of an array that a frame does without."""

OWN = 11
"""Fields of a frame that are its own, the first ones; it shares the others with the next one of its size."""

STAGES = ("project", "sort", "bin", "composite")


class Image(NamedTuple):
    """What is drawn into, row by row, and what is behind it; see `Rendering`.

    Attributes
    ----------
    past_caches : bool
        Whether it is written past the caches, which a large one would only empty; its rows are whole cache lines.
    """

    width: int
    height: int
    background: F32
    colors: F32
    alphas: F32
    depths: F32 | None
    past_caches: bool = False


class Window(NamedTuple):
    """The tiles that are drawn, counted row by row: whole rows of them, or some of one row."""

    first_tile: int
    end_tile: int

    def pixels(self, width: int, height: int) -> tuple[int, int, int, int]:
        """Return the first column and row of pixels, and the last, in an image of this size."""
        columns = -(-width // TILE)
        (top, left), (bottom, right) = divmod(self.first_tile, columns), divmod(self.end_tile - 1, columns)
        last_x, last_y = TILE * right + TILE - 1, TILE * bottom + TILE - 1
        return TILE * left, TILE * top, min(last_x, width - 1), min(last_y, height - 1)


def whole(width: int, height: int) -> Window:
    """Return the window that is all of an image."""
    return Window(0, -(-width // TILE) * -(-height // TILE))


class Frame(NamedTuple):
    """One frame; what `Prepared` describes is flat here, and the work arrays may be longer than the frame needs.

    Attributes
    ----------
    numbers : ndarray of float32
        The camera's and the options', see `camera_numbers`.
    viewmat : ndarray of float64, [12]
        The first three rows of the world-to-camera matrix.
    nearest_key : int
        What all keys are counted from: that of the near plane.
    blocks : ndarray of int32, [B]
        Which blocks of the scene are drawn.
    train_depths, frusta : ndarray of float32
        See `TrainDepths`; empty where no training camera is known.
    first_tile, end_tile : int
        See `Window`; what touches no tile of it is not seen.
    records : ndarray of float32, [B * BLOCK * 8]
        One row for each visible splat, see `record`; those of a block start where it would if only these were.
    depth_keys : ndarray of uint32, [B * BLOCK]
        What each record is sorted by, see `depth_key`.
    tiles : ndarray of uint64, [B * BLOCK]
        First tile of each record, 16 bits of its column and then of its row; above, the last tile.
    visible : ndarray of int32, [B]
        Records of each block.
    isect_ids : ndarray of int32
        May turn out too short: then nothing is composited, and `draw` returns what it needs.
    """

    numbers: F32
    viewmat: npt.NDArray[np.float64]
    nearest_key: int
    image: Image
    blocks: npt.NDArray[np.int32]
    coefficients: int
    bounds: F32
    train_depths: F32
    frusta: F32
    first_tile: int
    end_tile: int
    tile_columns: int
    workers: int
    past_caches: bool
    coefficients_stored: int
    means: F32
    covars: F32
    log2_opacities: F32
    base_colors: F32
    sh_rest: npt.NDArray[np.uint16]
    quats: F32
    scales: F32
    records: F32
    halves: npt.NDArray[np.uint16]
    depth_keys: npt.NDArray[np.uint32]
    tiles: npt.NDArray[np.uint64]
    visible: npt.NDArray[np.int32]
    pairs: npt.NDArray[np.uint64]
    order: npt.NDArray[np.int32]
    sorted_tiles: npt.NDArray[np.uint64]
    isect_ids: npt.NDArray[np.int32]
    sort_counts: I32
    sort_cursors: I32
    tile_steps: I32
    tile_counts: I32
    tile_cursors: I32
    scratch: F32
    touched: npt.NDArray[np.uint16]
    touching: npt.NDArray[np.uint64]
    team: I64
    results: I64
    stamps: I64


def new_image(scene: Prepared, camera: Camera, options: RenderOptions) -> Image:
    """Return an image of unspecified content that nobody else holds."""
    height, width, buffers = camera.height, camera.width, scene.buffers
    return Image(
        width,
        height,
        np.asarray(options.background, np.float32),
        colors=buffers.image(height * width * 3),
        alphas=buffers.image(height * width),
        depths=buffers.image(height * width) if options.depths else None,
        past_caches=width % TILE == 0 and PIXEL * width * height > CACHES,
    )


def new_frame(
    scene: Prepared,
    blocks: npt.NDArray[np.int32],
    camera: Camera,
    options: RenderOptions,
    pairs: int,
    *,
    image: Image | None = None,
    window: Window | None = None,
) -> Frame:
    """Return a frame of these blocks with room for so many pairs of a tile and a splat.

    It draws a window of an image, or all of a new one.
    """
    size = camera.width, camera.height, options.worker_count, pairs, len(blocks)
    if scene.last_size != size:
        # What it held of larger arrays goes before they come; Ctrl-C or a fork may come before all is of one size.
        scene.last_size, scene.last_frame, scene.last_known = (), None, None
        scene.last_frame = _frame_of_size(scene, *size)
        scene.last_known = known(scene.last_frame[OWN:])
        scene.last_size = size
    window = window or whole(camera.width, camera.height)
    own = (
        camera_numbers(camera, options, window.pixels(camera.width, camera.height)),
        camera.viewmat.ravel()[:12],
        depth_key(options.near_plane),
        image or new_image(scene, camera, options),
        blocks,
        scene.coefficients_used(options.sh_degree),
        *_near(scene, options),
        *window,
    )
    return Frame(*own, *scene.last_frame[OWN:])


def depth_key(depth: float) -> int:
    """Return the bits of a positive depth that it is sorted by, those of `KEY_SHIFT` left out."""
    return int(np.float64(depth).view(np.uint64)) >> KEY_SHIFT


def sight(scene: Prepared, camera: Camera, options: RenderOptions, window: Window) -> tuple[F32, F32]:
    """Return what says which blocks may reach into a window: `camera_numbers`, and the bounds of the blocks."""
    bounds, _, _ = _near(scene, options)
    return camera_numbers(camera, options, window.pixels(camera.width, camera.height)), bounds


def _near(scene: Prepared, options: RenderOptions) -> tuple[F32, F32, F32]:
    """Return what a frame holds of how near training cameras came: ``bounds``, ``train_depths``, ``frusta``."""
    known = train_depths_of(scene, options)
    if known is None:
        return scene.bounds, NONE, NONE
    return known.widened(scene.bounds, options), known.depths, known.frusta


def _frame_of_size(scene: Prepared, width: int, height: int, workers: int, pairs: int, blocks: int) -> Frame:
    """Return what frames of one size share; what each has of its own is empty."""
    buffers, padded = scene.buffers, blocks * BLOCK
    tile_columns, tile_rows = -(-width // TILE), -(-height // TILE)
    tile_count = tile_columns * tile_rows
    records = buffers.array("records", padded * LENGTH, np.float32)

    def by_worker(name: str, length: int, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
        return buffers.array(name, workers * length, dtype)[: workers * length].reshape(workers, length)

    return Frame(
        numbers=NONE,
        viewmat=NONE.astype(np.float64),
        nearest_key=0,
        image=Image(width, height, NONE, NONE, NONE, None),
        blocks=scene.blocks,
        coefficients=0,
        bounds=scene.bounds,
        train_depths=NONE,
        frusta=NONE,
        first_tile=0,
        end_tile=tile_count,
        tile_columns=tile_columns,
        workers=workers,
        past_caches=4 * padded * LENGTH > CACHES,
        coefficients_stored=scene.coefficients,
        means=scene.means,
        covars=scene.covars,
        log2_opacities=scene.log2_opacities,
        base_colors=scene.base_colors,
        sh_rest=scene.sh_rest,
        quats=scene.quats,
        scales=scene.scales,
        records=records,
        halves=records.view(np.uint16),
        depth_keys=buffers.array("depth_keys", padded, np.uint32),
        tiles=buffers.array("tiles", padded, np.uint64),
        visible=buffers.array("visible", blocks, np.int32)[:blocks],
        pairs=buffers.array("pairs", padded + SLACK, np.uint64),
        order=buffers.array("order", padded, np.int32),
        sorted_tiles=buffers.array("sorted_tiles", padded, np.uint64),
        isect_ids=buffers.array("isect_ids", pairs + SLACK, np.int32),
        sort_counts=by_worker("sort_counts", HIGH_BUCKETS, np.int32),
        sort_cursors=by_worker("sort_cursors", HIGH_BUCKETS, np.int32),
        tile_steps=by_worker("tile_steps", tile_count + tile_columns + tile_rows + 1, np.int32),
        tile_counts=by_worker("tile_counts", tile_count, np.int32),
        tile_cursors=by_worker("tile_cursors", tile_count, np.int32),
        scratch=by_worker("scratch", SCRATCH, np.float32),
        touched=by_worker("touched", BATCH, np.uint16),
        touching=by_worker("touching", CELLS, np.uint64),
        team=_threads.new_team(COUNTERS),
        results=by_worker("results", 8, np.int64),
        stamps=buffers.array("stamps", len(STAGES), np.int64),  # of this length, as it never grows
    )


def camera_numbers(camera: Camera, options: RenderOptions, window: tuple[int, int, int, int] | None = None) -> F32:
    """Return the world-to-camera matrix, its first three rows, then what `project` names, and the eye.

    Six more are for `in_sight`: where the window ends on the right, left, below and above, as tangents, and
    how far a splat of scale 1 reaches to the side and up. Then comes what near splats are widened by, and last
    the window's first column and row of pixels. Without a window, see `Window.pixels`, all of the image is one.
    """
    (fx, _, cx), (_, fy, cy), _ = camera.K.tolist()
    first_x, first_y, last_x, last_y = window or (0, 0, camera.width - 1, camera.height - 1)
    margin = (JACOBIAN_LIMIT - 1.0) * 0.5
    focal = math.sqrt(fx * fy)
    added, reference = options.filter2d(focal)
    u_min, u_max = -cx / fx - margin * camera.width / fx, (camera.width - cx) / fx + margin * camera.width / fx
    v_min, v_max = -cy / fy - margin * camera.height / fy, (camera.height - cy) / fy + margin * camera.height / fy
    log2_alpha_min = math.log2(options.alpha_min)
    extent = min(math.sqrt(-2.0 * math.log(2.0) * log2_alpha_min), options.sigma_extent)
    spare = 1.0 + extent * math.sqrt(added)  # a pixel more than rounding can take away
    # One array made of one list: each call of NumPy takes microseconds, and a small frame is short.
    first, second, third, _ = camera.viewmat.tolist()
    return np.array([
        *first, *second, *third,
        fx, fy, cx, cy, u_min, u_max, v_min, v_max, added, reference, options.near_plane, options.far_plane,
        log2_alpha_min, options.sigma_extent**2, last_x, last_y,
        *camera.eye.tolist(),
        (last_x + 1 - cx + spare) / fx, (cx - first_x + spare) / fx,
        (last_y + 1 - cy + spare) / fy, (cy - first_y + spare) / fy,
        # A blur of the image is as wide as high, whatever its pixels are.
        extent * max(math.hypot(1.0, max(-u_min, u_max)), focal / fx),
        extent * max(math.hypot(1.0, max(-v_min, v_max)), focal / fy),
        options.near_blur(focal), first_x, first_y,
    ], np.float32)  # fmt: skip
