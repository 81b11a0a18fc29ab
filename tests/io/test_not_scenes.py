"""What people open in place of a scene is named for what it is, whatever its name says, and never drawn."""

from __future__ import annotations

import gzip
import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.io.sogs import zipped
from tests.io.test_npz import trained
from tests.scenes import random_gaussians
from tsplat import io
from tsplat.errors import LoadError
from tsplat.io.formats import FORMATS

SUFFIXES = sorted({suffix for known in FORMATS for suffix in known.suffixes} | {"", ".zip", ".txt"})

PAGE = b"<!DOCTYPE html>\n<html><head><title>Sign \x1b[31min</title></head><body></body></html>"
LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:%s\nsize 248113034\n" % (b"ab" * 32)
DENIED = b'<?xml version="1.0" encoding="UTF-8"?>\n<Error><Code>AccessDenied</Code><Message>no</Message></Error>'
TILESET = {"asset": {"version": "1.1"}, "geometricError": 1.0, "root": {"content": {"uri": "0/0.glb"}}}
CAMERAS = [{"id": 0, "rotation": [], "position": [], "width": 1, "height": 1, "fx": 1, "fy": 1}]


def torch_zip(pickled: bytes = b"\x80\x02.") -> bytes:
    return zipped({"archive/data.pkl": pickled, "archive/data/0": bytes(64), "archive/version": b"3\n"})


THINGS: dict[str, tuple[bytes, str]] = {
    "a page": (PAGE, r"is a web page with the title 'Sign \\x1b\[31min'.*download the file"),
    "a page of 32 n bytes": (PAGE + b" " * (-len(PAGE) % 32), "is a web page"),
    "a page in capitals": (b"\xef\xbb\xbf  <HTML LANG=en><TITLE></TITLE>", "is a web page, not"),
    "a page in UTF-16": ("\ufeff<html><title>Ж</title>".encode("utf-16-le"), "is a web page with the title 'Ж'"),
    "a page in Latin-1": (b"<html><title>Stra\xdfe</title></html>", "is a web page with the title 'Straße'"),
    "a page behind a comment": (b"<!-- saved from -->\n<!doctype html><p>", "is a web page"),
    "a page of XHTML": (
        b'<?xml version="1.0" encoding="UTF-8"?>\n<!DOCTYPE html PUBLIC "-//W3C">',
        "is a web page",
    ),
    "a page of spaces": (b"<title>" + b" " * 8000, "is a web page, not"),
    "a script": (b"<script>location = 'login'</script>", "is a web page"),
    "a page in gzip": (gzip.compress(PAGE), "is a web page"),
    "an LFS pointer": (LFS, "is a Git LFS pointer to 248,113,034 bytes.*git lfs pull"),
    "an old LFS pointer": (LFS.replace(b"git-lfs", b"hawser"), "is a Git LFS pointer to 248,113,034 bytes"),
    "an annex pointer": (b"/annex/objects/SHA256E-s123--abc.ply\n", "git-annex pointer.*git annex get"),
    "an error of S3": (DENIED, "is the error 'AccessDenied' of a server"),
    "XML": (b'<?xml version="1.0"?><COLLADA>', "is XML"),
    "an error in JSON": (b'{"error": {"message": "Not\\u001b found"}}', r"what a server said.*'Not\\x1b found'"),
    "a message in JSON": (b'{"status": 404, "message": "no such key"}', "what a server said.*'no such key'"),
    "a tileset": (
        json.dumps(TILESET).encode(),
        r"is a tileset of 3D Tiles.*open what it names, such as '0/0\.glb'",
    ),
    "cameras": (json.dumps(CAMERAS).encode(), "lists cameras, not splats; open the scene"),
    "transforms": (b'{"camera_angle_x": 0.6, "frames": []}', "lists cameras, not splats"),
    "a list": (b"[1, 2]", r"is text.*'\[1, 2\]'"),
    "words": (b"Not Found", "is text, not the scene itself: 'Not Found'"),
    "many words": (b"404: " + b"Not Found " * 99, r"'404: Not Found .*\.\.\.'"),
    "words in UTF-8": ("не найдено".encode(), "is text.*'не найдено'"),
    "a torrent": (b"d8:announce35:udp://tracker", "is a torrent"),
    "a PNG": (b"\x89PNG\r\n\x1a\n" + bytes(24), "is a PNG picture"),
    "a JPEG": (b"\xff\xd8\xff\xe0" + bytes(28), "is a JPEG picture"),
    "a plane": (b"RIFF\0\0\0\0WEBPVP8L" + bytes(16), r"is a WebP picture.*meta\.json"),
    "a video": (b"\0\0\0\x20ftypisom" + bytes(20), "is a video"),
    "a PDF": (b"%PDF-1.7\n" + bytes(23), "is a PDF"),
    "7z": (b"7z\xbc\xaf\x27\x1c" + bytes(26), "is a 7z archive.*unpack it first"),
    "RAR": (b"Rar!\x1a\x07\x01\0" + bytes(24), "is a RAR archive"),
    "tar": (b"scene.ply".ljust(257, b"\0") + b"ustar\0" + bytes(249), "is a tar archive.*tar xf"),
    "tar in gzip": (
        gzip.compress(b"scene.ply".ljust(257, b"\0") + b"ustar\x0000" + bytes(247)),
        "is a tar archive",
    ),
    "xz": (b"\xfd7zXZ\0" + bytes(26), "is packed with xz"),
    "zstd": (b"\x28\xb5\x2f\xfd" + bytes(28), "is packed with zstd"),
    "LAS": (b"LASF" + bytes(28), "is a LAS or LAZ point cloud"),
    "an array": (b"\x93NUMPY\x01\0" + bytes(24), "is a single NumPy array"),
    "a pickle": (pickle.dumps({"means": 1}), "is a Python pickle, which is not opened"),
    "a checkpoint": (torch_zip(), "is a PyTorch checkpoint.*torch.load.*weights_only=True.*numpy.savez"),
    "an old checkpoint": (b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.", "is a PyTorch checkpoint"),
    "a zip of nothing": (zipped({}), "is a zip of nothing|'meta.json' is missing|holds no scenes"),
    "nothing": (b"", "is empty"),
}


@pytest.mark.parametrize("thing", THINGS)
def test_what_is_no_scene_is_named_whatever_its_suffix(tmp_path: Path, thing: str) -> None:
    content, problem = THINGS[thing]
    for suffix in SUFFIXES:
        path = tmp_path / f"scene{suffix}"
        path.write_bytes(content)
        with pytest.raises(LoadError, match=problem) as caught:
            io.load(path)
        assert str(caught.value).isprintable()
        assert str(caught.value).startswith(f"{path}: ")
        with pytest.raises(LoadError):
            io.load(path, format="splat")


def test_the_training_code_of_kerbl_keeps_no_names_so_its_ply_is_named(tmp_path: Path) -> None:
    path = tmp_path / "chkpnt30000.pth"
    path.write_bytes(torch_zip())
    with pytest.raises(
        LoadError, match=r"is a PyTorch checkpoint.*open the point_cloud\.ply that its training saved"
    ):
        io.load(path)


def test_a_pickle_is_never_run(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, ...]:
            return Path.touch, (tmp_path / "sprung",)

    for name, content in {"a.pt": torch_zip(pickle.dumps(Trap())), "b.pkl": pickle.dumps(Trap())}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(LoadError):
            io.load(tmp_path / name)
    assert not (tmp_path / "sprung").exists()


def test_the_command_that_a_checkpoint_is_exported_by_does_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is run with a stand-in for PyTorch, which is no dependency of ours: a module whose ``load`` unpickles."""
    scene = random_gaussians(np.random.default_rng(1), 9, 1)
    stand_in = (
        "import pickle\ndef load(path, where, *, weights_only):\n    return pickle.load(open('kept.pkl', 'rb'))\n"
    )
    (tmp_path / "torch.py").write_text(stand_in)
    monkeypatch.chdir(tmp_path)
    Path("ckpt_29999_rank0.pt").write_bytes(torch_zip())
    with pytest.raises(LoadError) as caught:
        io.load("ckpt_29999_rank0.pt")
    code = str(caught.value).partition('python -c "')[2].removesuffix('"')
    splatfacto = {f"_model.gauss_params.{name}": array for name, array in trained(scene).items()}
    for kept in ({"step": 1, "splats": trained(scene)}, {"pipeline": splatfacto | {"_model.other": np.ones(3)}}):
        Path("kept.pkl").write_bytes(pickle.dumps(kept))
        subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
        np.testing.assert_allclose(io.load("scene.npz").means, scene.means)
