"""A streamed SOG is drawn with its own levels: at rest to the bit as its finest, within a budget leaf by leaf."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import tsplat
from tests.io.sogs import made_up
from tests.lod.streams import write_meta, write_stream
from tests.raster.compare import front_camera, psnr
from tests.scenes import random_gaussians, shared_scenes
from tsplat._jit import JIT
from tsplat.camera import Camera
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.framing import start_pose
from tsplat.io import load, save
from tsplat.io.sog_levels import is_streamed_file, open_levels
from tsplat.lod import Cut, Streamed, open_streamed, rasterize_all, rasterize_within, read_levels
from tsplat.lod.streamed_reader import Reader
from tsplat.raster import rasterize
from tsplat.raster.prepare import BLOCK, BOUNDS, empty
from tsplat.raster.train_depths import TrainDepths
from tsplat.rendering import RenderOptions
from tsplat.scene import Gaussians
from tsplat.train_views import TrainViews

pytestmark = pytest.mark.skipif(not JIT, reason="thousands of splats take minutes without a compiler")

N, LEAVES, LEVELS = 6000, 5, 4
CAMERA = front_camera(96, 64)
OPTIONS = RenderOptions(antialias="mip", depths=False, threads=2)


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    cloud = random_gaussians(np.random.default_rng(0), N, 1)
    scene = Gaussians(cloud.means, cloud.quats, 0.2 * cloud.scales, *cloud.arrays[3:])
    return write_stream(tmp_path_factory.mktemp("streamed"), scene, LEAVES, LEVELS)


@pytest.fixture(scope="module")
def streamed(path: Path) -> Streamed:
    return open_streamed(path)


def coarsest(path: Path) -> Streamed:
    return read_levels(open_levels(path), whole=False, progress=lambda _: None)


def drawn_levels(streamed: Streamed, levels: list[list[int]], camera: Camera, budget: int) -> list[list[int]]:
    """Return which levels of each leaf are drawn, all blocks of a level or none."""
    blocks = set(Cut(streamed.tree).blocks(camera, OPTIONS, budget).tolist())
    firsts = streamed.tree.blocks
    found: list[list[int]] = [[] for _ in levels]
    for leaf, nodes in enumerate(levels):
        for level, node in enumerate(nodes):
            own = set(range(int(firsts[node]), int(firsts[node + 1])))
            assert own <= blocks or not own & blocks
            found[leaf] += [level] * (own <= blocks)
            blocks -= own
    assert not blocks
    return found


def test_at_rest_it_is_drawn_to_the_bit_as_its_finest_level(streamed: Streamed, path: Path) -> None:
    finest = load(path, lod=0)
    ours, theirs = rasterize_all(streamed, CAMERA, OPTIONS), rasterize(finest, CAMERA, OPTIONS)
    np.testing.assert_array_equal(ours.colors, theirs.colors)
    np.testing.assert_array_equal(ours.alphas, theirs.alphas)
    assert ours.visible == theirs.visible > N // 2
    assert (len(streamed), streamed.sh_degree, streamed.antialiased) == (N, 1, False)


def test_a_scene_within_the_budget_is_drawn_to_the_bit(streamed: Streamed, path: Path) -> None:
    ours, theirs = tsplat.render(streamed, CAMERA, lod=N), tsplat.render(load(path), CAMERA)
    np.testing.assert_array_equal(ours.colors, theirs.colors)


@pytest.mark.parametrize("budget", [1, N // 4, N // 3, N // 2, 2 * N])
def test_of_each_leaf_one_level_is_drawn(streamed: Streamed, path: Path, budget: int) -> None:
    found = drawn_levels(streamed, open_levels(path).leaves, CAMERA, budget)
    assert [len(levels) for levels in found] == [1] * LEAVES
    if budget == 1:
        assert found == [[0]] * LEAVES
    if budget == 2 * N:
        assert found == [[LEVELS - 1]] * LEAVES


@pytest.mark.parametrize("budget", [N // 4, N // 3, N // 2])
def test_the_budget_is_kept(streamed: Streamed, budget: int) -> None:
    assert 0.6 * budget < rasterize_within(streamed, CAMERA, OPTIONS, budget).visible <= 1.1 * budget


def test_leaves_near_the_eye_are_finer_than_far_ones(streamed: Streamed, path: Path) -> None:
    near = Camera.look_at((-1.3, 0, 0), (1.0, 0, 0), (0, -1, 0), width=96, height=64, fov_y=60.0)
    found = [levels[0] for levels in drawn_levels(streamed, open_levels(path).leaves, near, N // 3)]
    assert found[-1] > found[0]  # the last leaf of the tree comes first


def test_leaf_by_leaf_looks_more_like_the_scene_than_a_level_for_all(streamed: Streamed, path: Path) -> None:
    near = Camera.look_at((-2.2, 0, 0), (0, 0, 0), (0, -1, 0), width=96, height=64, fov_y=80.0)
    whole, uniform = (rasterize(load(path, lod=level), near, OPTIONS) for level in (0, 1))
    ours = rasterize_within(streamed, near, OPTIONS, uniform.visible)
    assert ours.visible <= 1.05 * uniform.visible
    assert psnr(ours.colors, whole.colors) > psnr(uniform.colors, whole.colors)


def test_what_is_out_of_sight_gets_nothing(streamed: Streamed) -> None:
    away = Camera.look_at((0, 0, -4), (0, 0, -8), (0, -1, 0), width=64, height=48, fov_y=40.0)
    assert not len(Cut(streamed.tree).blocks(away, OPTIONS, N))


@pytest.mark.parametrize("backwards", [False, True])
def test_bounds_hold_all_that_a_node_stands_for_in_whatever_order_it_was_read(path: Path, backwards: bool) -> None:
    levels = open_levels(path)
    reader = Reader(levels)
    if backwards:
        reader.left.reverse()
    while reader.left:
        reader.read_next(1, lambda _: None, warn=True)
    tree, bounds = reader.tree, reader.tree.bounds.reshape(-1, BOUNDS)
    np.testing.assert_array_equal(tree.errors, open_streamed(path).tree.errors)
    means = tree.scene.means.reshape(3, -1)
    opaque = tree.scene.log2_opacities > -200
    for leaf in levels.leaves:
        for above, node in enumerate(leaf):
            rows = slice(BLOCK * int(tree.blocks[node]), BLOCK * int(tree.blocks[node + 1]))
            inside = means[:, rows][:, opaque[rows]].T
            for other in leaf[: above + 1]:
                apart = np.linalg.norm(inside - bounds[other, :3], axis=1)
                assert apart.max() <= bounds[other, 3] * (1 + 1e-5) + 1e-6
                assert bounds[node, 4] <= bounds[other, 4]


def test_only_the_coarsest_levels_are_drawn_until_the_others_are_read(path: Path) -> None:
    begun = coarsest(path)
    assert not begun.complete
    first, coarse = rasterize_within(begun, CAMERA, OPTIONS, 2 * N), load(path, lod=LEVELS - 1)
    np.testing.assert_array_equal(first.colors, rasterize(coarse, CAMERA, OPTIONS).colors)
    seen: list[float] = []
    begun.read_rest(seen.append)
    assert begun.complete
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    then, whole = (rasterize_within(each, CAMERA, OPTIONS, N // 2) for each in (begun, open_streamed(path)))
    np.testing.assert_array_equal(then.colors, whole.colors)


def test_what_is_read_later_is_as_near_to_the_training_cameras_as_if_it_had_been_read_before(path: Path) -> None:
    near = Camera.look_at((0.6, 0.2, -0.9), (0.3, 0, 0), (0, -1, 0), width=96, height=64, fov_y=50.0)
    options = RenderOptions(antialias="relative", train_focal=30.0, train_views=TrainViews.of([CAMERA]), threads=2)
    begun = coarsest(path)
    rasterize_within(begun, near, options, 2 * N)
    begun.read_rest()
    for budget in (N // 4, N // 2):
        then, whole = (rasterize_within(each, near, options, budget) for each in (begun, open_streamed(path)))
        np.testing.assert_array_equal(then.colors, whole.colors)
    ours, theirs = rasterize_all(begun, near, options), rasterize(load(path), near, options)
    np.testing.assert_array_equal(ours.colors, theirs.colors)
    known = begun.tree.scene.train_depths
    assert known is not None
    for bounds in (begun.tree.bounds, begun.tree.scene.bounds):
        fresh = TrainDepths(known.views, 0).widened(bounds, options)
        np.testing.assert_array_equal(known.widened(bounds, options), fresh)


def test_drawing_all_of_it_reads_all_of_it(path: Path) -> None:
    begun, finest = coarsest(path), load(path)
    np.testing.assert_array_equal(
        rasterize_all(begun, CAMERA, OPTIONS).colors, rasterize(finest, CAMERA, OPTIONS).colors
    )


def test_the_start_view_is_about_that_of_the_finest_level(path: Path) -> None:
    ours, theirs = (start_pose(each, aspect=1.5, fov_y=50.0) for each in (coarsest(path).sample, load(path)))
    np.testing.assert_allclose(ours.target, theirs.target, atol=0.1)
    assert ours.up == theirs.up
    assert ours.distance == pytest.approx(theirs.distance, rel=0.1)


def test_progress_grows_to_its_end(path: Path) -> None:
    heard: list[float] = []
    open_streamed(path, heard.append)
    assert heard == sorted(heard)
    assert heard[-1] == 1.0


def a_file(folder: Path, name: str, gaussians: Gaussians) -> Gaussians:
    save(folder / name, gaussians)
    return load(folder / name)


def test_runs_of_files_that_hold_several_levels_and_leaves_are_told_apart(tmp_path: Path) -> None:
    a_file(tmp_path, "a.sog", random_gaussians(np.random.default_rng(1), 900, 0))
    a_file(tmp_path, "b.sog", random_gaussians(np.random.default_rng(2), 700, 1))
    leaves = [
        {"lods": {"0": {"file": 1, "offset": 100, "count": 600}, "1": {"file": 0, "offset": 0, "count": 300}}},
        {"lods": {"0": {"file": 0, "offset": 300, "count": 600}, "2": {"file": 1, "offset": 0, "count": 100}}},
    ]
    path = write_meta(tmp_path, ["a.sog", "b.sog"], 3, leaves)
    found, whole = open_streamed(path), load(path)
    assert len(found) == len(whole) == 1200
    np.testing.assert_array_equal(
        rasterize_all(found, CAMERA, OPTIONS).colors, rasterize(whole, CAMERA, OPTIONS).colors
    )
    least = rasterize_within(found, CAMERA, OPTIONS, 1)
    np.testing.assert_array_equal(least.colors, rasterize(load(path, lod=2), CAMERA, OPTIONS).colors)


def test_the_environment_is_drawn_behind_every_level(tmp_path: Path) -> None:
    sky = a_file(tmp_path, "sky.sog", random_gaussians(np.random.default_rng(1), 300, 0))
    a_file(tmp_path, "a.sog", random_gaussians(np.random.default_rng(2), 300, 0))
    leaves = [
        {"lods": {"0": {"file": 0, "offset": 0, "count": 250}, "1": {"file": 0, "offset": 250, "count": 50}}}
    ]
    found = open_streamed(write_meta(tmp_path, ["a.sog"], 2, leaves, environment="sky.sog"))
    assert len(found) == 550
    least = rasterize_within(found, CAMERA, OPTIONS, 1)
    assert least.visible > rasterize(sky, CAMERA, OPTIONS).visible
    assert set(Cut(found.tree).blocks(CAMERA, OPTIONS, 1)) == {1, 2, 3}


def test_levels_without_splats_and_levels_that_are_the_next_finer_one_are_none(tmp_path: Path) -> None:
    a_file(tmp_path, "a.sog", random_gaussians(np.random.default_rng(1), 300, 0))
    run, none = {"file": 0, "offset": 0, "count": 300}, {"file": 0, "offset": 9, "count": 0}
    path = write_meta(tmp_path, ["a.sog"], 4, [{"lods": {"0": run, "1": run, "2": none}}])
    assert open_levels(path).leaves == [[0]]
    assert len(open_streamed(path)) == 300


@pytest.fixture
def unbounded(tmp_path: Path) -> Path:
    """Return a streamed scene whose finer level is of splats that lie nowhere."""
    rng = np.random.default_rng(4)
    (tmp_path / "b.sog").write_bytes(made_up(rng, 7).zipped())
    scene = made_up(rng, 7)
    scene.meta["means"]["mins"] = scene.meta["means"]["maxs"] = [1e3, 1e3, 1e3]
    (tmp_path / "a.sog").write_bytes(scene.zipped())
    runs = {str(level): {"file": level, "offset": 0, "count": 7} for level in range(2)}
    return write_meta(tmp_path, ["a.sog", "b.sog"], 2, [{"lods": runs}])


def test_splats_that_cannot_be_drawn_are_left_out_with_a_warning(unbounded: Path) -> None:
    with pytest.warns(LoadWarning, match=r"a\.sog: dropped 7 of 7 splats"):
        found = open_streamed(unbounded)
    assert rasterize_all(found, CAMERA, OPTIONS).visible == 0
    assert np.isfinite(found.tree.bounds).all()
    for budget in (1, 100):
        assert np.isfinite(rasterize_within(found, CAMERA, OPTIONS, budget).colors).all()


def test_splats_as_large_as_numbers_go_are_drawn_without_a_warning(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for name in ("a.sog", "b.sog"):
        scene = made_up(rng, 7)
        scene.meta["scales"]["codebook"] = [80.0 + step for step in range(16)]
        scene.meta["means"] |= {"mins": [-88.0] * 3, "maxs": [88.0] * 3}
        (tmp_path / name).write_bytes(scene.zipped())
    runs = {str(level): {"file": level, "offset": 0, "count": 7} for level in range(2)}
    path = write_meta(tmp_path, ["a.sog", "b.sog"], 2, [{"lods": runs}])
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        warnings.simplefilter("ignore", LoadWarning)
        found = open_streamed(path)
        for budget in (1, 10, 100):
            rasterize_within(found, CAMERA, OPTIONS, budget)
    assert np.isinf(found.tree.errors).any()


def test_reading_beside_the_frames_warns_nobody(unbounded: Path) -> None:
    begun = coarsest(unbounded)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        begun.read_rest()


def test_leaves_of_hardly_any_splats_take_no_memory(tmp_path: Path) -> None:
    a_file(tmp_path, "a.sog", random_gaussians(np.random.default_rng(1), 3000, 0))
    leaves = [{"lods": {"0": {"file": 0, "offset": run, "count": 1}}} for run in range(3000)]
    path = write_meta(tmp_path, ["a.sog"], 1, leaves)
    with pytest.raises(LoadError, match=r"has leaves of hardly any splats; load one level of it"):
        open_streamed(path)
    assert len(load(path)) == 3000


def test_what_is_no_streamed_scene_is_told_apart(path: Path, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text("{")
    (tmp_path / "y.json").write_text('{"means": {}}')
    assert is_streamed_file(path)
    assert not any(
        map(is_streamed_file, (tmp_path / "x.json", tmp_path / "y.json", tmp_path / "none.json", tmp_path))
    )


def test_what_is_no_lod_meta_json_is_refused(path: Path, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text('{"means": {}}')
    with pytest.raises(LoadError, match=r"x\.json: is no lod-meta\.json"):
        open_streamed(tmp_path / "x.json")
    with pytest.raises(CorruptFileError, match="is not JSON"):
        open_streamed(path.parent / "0_0.sog")


def test_what_cannot_be_read_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(LoadError, match=r"lod-meta\.json: is missing, expected a file of the scene"):
        open_streamed(tmp_path / "lod-meta.json")


def test_a_real_streamed_scene_is_drawn_to_the_bit_as_its_finest_level() -> None:
    if (folder := shared_scenes()) is None:
        pytest.skip("no folder of real scenes")
    path = folder / "playbot" / "lod-meta.json"
    found, finest = open_streamed(path), load(path)
    camera = start_pose(finest, aspect=1.5, fov_y=50.0).camera(240, 160, 50.0)
    whole = rasterize(finest, camera, OPTIONS)
    np.testing.assert_array_equal(rasterize_all(found, camera, OPTIONS).colors, whole.colors)
    within = rasterize_within(found, camera, OPTIONS, 96_000)
    assert 50_000 < within.visible < 100_000
    assert psnr(within.colors, whole.colors) > 35.0


def test_more_splats_than_can_be_counted_are_too_many_for_memory() -> None:
    with pytest.raises(MemoryError, match="splats"):
        empty(1 << 31, 0)
