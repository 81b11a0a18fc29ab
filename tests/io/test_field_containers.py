"""Files as people report them: what holds a scene, what only looks like one, and what says its own axes.

They lie in ``field`` beside the shared scenes; without them, the tests of each kind build their own.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import field_files
from tsplat import io
from tsplat.errors import LoadError

FIELD = field_files()
pytestmark = pytest.mark.skipif(not FIELD.is_dir(), reason="no files from the field beside the scenes")

OPENED = {
    "c11_model": "ref_house.ply",
    "c11_model/point_cloud": "ref_house.ply",
    "c11b_ply_inside.zip": "ref_house.ply",
    "c11d": "ref_statue.ply",
    "c11d/capture": "ref_statue.ply",
    "c11d_sub.zip": "ref_statue.ply",
    "c15r_room": "c15r_room/room.ply",
    "c17_gsplat_png": "ref_statue.ply",
    "c17_gsplat_png/meta.json": "ref_statue.ply",
    "c21_spz_extension.spz": "ref_statue.ply",
    "f3_v3_says_rdf.spz": "ref_statue.ply",
    "f4_v4_says_rdf.spz": "ref_statue.ply",
}
NAMED = {
    "c11c_checkpoint.pt": "is a PyTorch checkpoint.*numpy.savez",
    "c12_html.ply": "is a web page with the title 'Sign in'",
    "c12_html.splat": "is a web page with the title 'Sign in'",
    "c12b_html_x32.splat": "is a web page with the title 'Sign in'",
    "c12_lfs.ply": "is a Git LFS pointer.*git lfs pull",
    "c12_lfs.spz": "is a Git LFS pointer.*git lfs pull",
    "c20_tileset.json": r"is a tileset of 3D Tiles.*'0/0\.glb'",
}


def place(name: str) -> Path:
    return FIELD / name


@pytest.mark.parametrize("name", OPENED)
def test_what_holds_a_scene_is_opened_upright_and_in_silence(name: str) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found, expected = io.load(place(name)), io.load(place(OPENED[name]))
    size = np.ptp(expected.means, axis=0).max()
    for end in (np.min, np.median, np.max):
        np.testing.assert_allclose(end(found.means, 0), end(expected.means, 0), atol=0.03 * size)
    np.testing.assert_allclose(found.sh[:, 0].mean(0), expected.sh[:, 0].mean(0), atol=0.1)


@pytest.mark.parametrize("name", NAMED)
def test_what_is_no_scene_is_named(name: str) -> None:
    with pytest.raises(LoadError, match=NAMED[name]):
        io.load(place(name))
