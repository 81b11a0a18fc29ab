"""Nodes of a glTF: what their matrices make of splats, and trees that are none."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from tests.io.gltfs import Made, check_alike, load_made, scene_of
from tests.scenes import random_gaussians
from tsplat.errors import CorruptFileError, LoadError, LoadWarning
from tsplat.raster.reference import covariances, sh_basis
from tsplat.scene import Gaussians

F64 = npt.NDArray[np.float64]

UPRIGHT = np.diag([-1.0, -1.0, 1.0])
S = np.sqrt(0.5)


def matrix(linear: npt.ArrayLike, offset: npt.ArrayLike = (0, 0, 0)) -> list[float]:
    """Return a node's matrix, column after column."""
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = linear, offset
    return [float(each) for each in whole.T.ravel()]


def random_turn(seed: int) -> F64:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return np.asarray(q * np.linalg.det(q))


def check_moved(found: Gaussians, before: Gaussians, linear: F64, turn: F64, offset: npt.ArrayLike = 0.0) -> None:
    """Compare a scene with what a matrix makes of another one, ``turn`` being its rotation."""
    linear = UPRIGHT @ linear
    np.testing.assert_allclose(
        found.means, before.means @ linear.T + UPRIGHT @ np.broadcast_to(offset, 3), atol=1e-5
    )
    expected = linear @ covariances(before.quats, before.scales) @ linear.T
    np.testing.assert_allclose(
        covariances(found.quats, found.scales), expected, atol=3e-6 * np.abs(expected).max()
    )
    directions = np.random.default_rng(0).normal(size=(30, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    k = before.sh.shape[1]
    seen = np.einsum("dk,nkc->ndc", sh_basis(directions)[:, :k], before.sh)
    moved = np.einsum("dk,nkc->ndc", sh_basis(directions @ (UPRIGHT @ turn).T)[:, :k], found.sh)
    np.testing.assert_allclose(moved, seen, atol=1e-5)


def loaded(folder: Path, before: Gaussians, *nodes: dict[str, Any]) -> Gaussians:
    """Load a scene whose nodes hang one under the other, the mesh at the last of them."""
    made = scene_of(before)
    made.root["nodes"] = [dict(node, children=[index + 1]) for index, node in enumerate(nodes)]
    del made.root["nodes"][-1]["children"]
    made.root["nodes"][-1]["mesh"] = 0
    return load_made(folder, made)


def test_translation_rotation_and_scale_apply_in_the_order_of_the_specification(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    before = random_gaussians(rng, 20, 3)
    # A quarter turn about y, xyzw, takes z to x.
    node = {"translation": [1, 2, 3], "rotation": [0, S, 0, S], "scale": [2, 2, 2]}
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    found = loaded(tmp_path, before, node)
    check_moved(found, before, 2 * turn, turn, [1, 2, 3])
    np.testing.assert_allclose(np.sort(found.scales), np.sort(2 * before.scales), rtol=1e-6)


def test_a_rotation_of_another_length_is_still_one(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 5, 1)
    check_alike(
        loaded(tmp_path, before, {"rotation": [0, 3, 0, 3]}), loaded(tmp_path, before, {"rotation": [0, S, 0, S]})
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degree", range(5))
def test_matrices_of_ancestors_multiply(tmp_path: Path, rng: np.random.Generator, seed: int, degree: int) -> None:
    before = random_gaussians(rng, 20, degree)
    first, second = random_turn(seed), random_turn(seed + 10)
    nodes = [{"matrix": matrix(0.5 * first, [3, 0, -1])}, {}, {"matrix": matrix(3 * second, [0, 1, 2])}]
    found = loaded(tmp_path, before, *nodes)
    check_moved(
        found, before, 1.5 * first @ second, first @ second, 0.5 * first @ [0, 1, 2] + np.array([3, 0, -1])
    )


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_uneven_scales_deform_ellipsoids_and_turn_colours(
    tmp_path: Path, rng: np.random.Generator, mirror: float
) -> None:
    before = random_gaussians(rng, 40, 2)
    turn = random_turn(3)
    linear = turn @ np.diag([0.2, 1.0, mirror * 4.0])
    found = loaded(tmp_path, before, {"matrix": matrix(linear)})
    check_moved(found, before, linear, turn @ np.diag([1.0, 1.0, mirror]))


@pytest.mark.parametrize("flip", [[1, 1, 1], [-1, 1, 1], [1, -1, -1], [-1, -1, -1]])
def test_ellipsoids_along_the_axes_stay_rotations_however_their_axes_are_ordered(
    tmp_path: Path, rng: np.random.Generator, flip: list[int]
) -> None:
    before = random_gaussians(rng, 6, 0)
    scales = np.array(list(itertools.permutations([0.0, 0.2, 0.3])))
    lying = Gaussians(before.means, np.tile([1, 0, 0, 0], (6, 1)), scales, before.opacities, before.sh)
    linear = np.diag([1.0, 1.5, 1.7]) * flip
    found = loaded(tmp_path, lying, {"matrix": matrix(linear)})
    check_moved(found, lying, linear, np.diag(flip).astype(float))


def test_a_mirror_turns_ellipsoids_and_colours_over(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 40, 3)
    mirror = np.diag([-1.0, 1.0, 1.0])
    found = loaded(tmp_path, before, {"scale": [-1, 1, 1]})
    check_moved(found, before, mirror, mirror)
    np.testing.assert_array_equal(found.scales, before.scales)


def test_a_shear_takes_colours_along_by_the_nearest_rotation(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 40, 2)
    shear = np.array([[1.0, 0.8, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    left, _, right = np.linalg.svd(shear)
    check_moved(loaded(tmp_path, before, {"matrix": matrix(shear)}), before, shear, left @ right)


def test_broken_splats_are_left_out_of_deformed_ones(tmp_path: Path, rng: np.random.Generator) -> None:
    before = random_gaussians(rng, 6, 1)
    made = scene_of(before)
    attributes = made.root["meshes"][0]["primitives"][0]["attributes"]
    scales, quats = before.scales.copy(), before.quats[:, [1, 2, 3, 0]]
    scales[1, 0], quats[2], quats[3, 1] = np.inf, 0.0, np.nan
    attributes["KHR_gaussian_splatting:SCALE"] = made.accessor(scales)
    attributes["KHR_gaussian_splatting:ROTATION"] = made.accessor(quats)
    made.root["nodes"] = [{"mesh": 0, "scale": [1, 2, 3]}]
    with pytest.warns(LoadWarning, match="dropped 3 of 6 splats"):
        found = load_made(tmp_path, made)
    kept = before.take([0, 4, 5])
    check_moved(found, kept, np.diag([1.0, 2.0, 3.0]), np.eye(3))


@pytest.mark.parametrize(
    "node",
    [
        {"scale": [1e200, 1e200, 1e200]},
        {"scale": [1e308, 1e-308, 1]},
        {"scale": [1e-320, 1e-320, 1e-320]},
        {"matrix": [1e308] * 16},
        {"translation": [1e308, -1e308, 0], "rotation": [1e150, 0, 0, 1e150]},
    ],
)
def test_numbers_without_bounds_leave_out_splats_or_flatten_them(
    tmp_path: Path, rng: np.random.Generator, node: dict[str, Any]
) -> None:
    made = scene_of(random_gaussians(rng, 6, 1))
    made.root["nodes"] = [dict(node, children=[1]), dict(node, mesh=0)]
    if node["scale"][0] < 1 if "scale" in node else False:
        with pytest.raises(LoadError, match="shows no KHR_gaussian_splatting"):
            load_made(tmp_path, made)
    else:
        with pytest.raises(LoadError, match="none of its 6 splats can be drawn"):
            load_made(tmp_path, made)


def test_a_scale_of_zero_hides_what_hangs_below_it(tmp_path: Path, rng: np.random.Generator) -> None:
    made = scene_of(random_gaussians(rng, 6, 1))
    made.root["nodes"] = [{"scale": [0, 0, 0], "children": [1]}, {"mesh": 0}, {"mesh": 0}]
    made.root["scenes"][0]["nodes"] = [0, 2]
    assert len(load_made(tmp_path, made)) == 6
    made.root["scenes"][0]["nodes"] = [0]
    with pytest.raises(LoadError, match="shows no KHR_gaussian_splatting, so it is no splat scene"):
        load_made(tmp_path, made)


def tree(nodes: list[dict[str, Any]], roots: list[int] | None = None) -> Made:
    made = scene_of(random_gaussians(np.random.default_rng(0), 2, 0))
    made.root["nodes"] = nodes
    made.root["scenes"] = [{"nodes": [0] if roots is None else roots}]
    return made


@pytest.mark.parametrize(
    ("made", "problem"),
    [
        (tree([{"children": [0], "mesh": 0}]), r"nodes\[0\] is reached twice, expected a tree"),
        (tree([{"children": [1]}, {"children": [2]}, {"children": [1]}]), r"nodes\[1\] is reached twice"),
        (
            tree([{"children": [1, 2]}, {"children": [3]}, {"children": [3]}, {"mesh": 0}]),
            r"nodes\[3\] is reached",
        ),
        (tree([{"mesh": 0}], [0, 0]), r"nodes\[0\] is reached twice"),
        (tree([{"mesh": 0}], [1]), r"scenes\[0\]\.nodes is \[1\], expected indices of the 1 nodes"),
        (tree([{"mesh": 1}]), r"nodes\[0\]\.mesh is 1, expected the index of one of 1 meshes"),
        (tree([{"mesh": True}]), r"nodes\[0\]\.mesh is True"),
        (tree([{"children": [-1]}]), r"nodes\[0\]\.children is \[-1\]"),
        (tree([{"children": 7}]), r"nodes\[0\]\.children is 7"),
        (tree([{"matrix": [1, 2, 3]}]), r"nodes\[0\]\.matrix is \[1, 2, 3\], expected 16 finite numbers"),
        (tree([{"matrix": [float("nan")] * 16}]), r"nodes\[0\]\.matrix is .*expected 16 finite"),
        (tree([{"rotation": [0, 0, 0, 0]}]), r"rotation is \[0, 0, 0, 0\], expected a quaternion"),
        (tree([{"scale": "big"}]), r"nodes\[0\]\.scale is 'big'"),
        (tree(["root"]), r"field nodes is \['root'\], expected a list of objects"),  # type: ignore[list-item]
    ],
)
def test_a_tree_that_is_none_is_refused(tmp_path: Path, made: Made, problem: str) -> None:
    with pytest.raises(CorruptFileError, match=problem) as caught:
        load_made(tmp_path, made)
    assert "\n" not in str(caught.value)


def test_a_long_chain_of_nodes_is_no_recursion(tmp_path: Path) -> None:
    links: list[dict[str, Any]] = [{"children": [index + 1]} for index in range(5_000)]
    assert len(load_made(tmp_path, tree([*links, {"mesh": 0}]))) == 2
