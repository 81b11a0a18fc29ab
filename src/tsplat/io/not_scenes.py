"""What people open in place of a scene: pages, pointers, pictures, archives; named, with what helps.

Nothing of such a file is run or unpacked, and what is quoted of it is short and printable.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from tsplat.errors import printable

QUOTED_CHARS = 60
"""At most so much of a file is quoted."""

CHECKPOINT = "is a PyTorch checkpoint, not a scene; "
EXPORT = (
    'export its splats: python -c "import numpy, torch; c = torch.load('
    "'{name}', 'cpu', weights_only=True); numpy.savez('scene.npz', **c.get('splats') or c['pipeline'])\""
)
"""gsplat keeps splats under the first key, nerfstudio under the second; ``weights_only`` runs no code of it."""

OF_KERBL = "open the point_cloud.ply that its training saved as well"


class Kind(NamedTuple):
    """A kind of file that is no scene: what it begins with, and from which byte; what it is; what helps."""

    magic: bytes
    what: str
    remedy: str
    place: int = 0


LFS_POINTER = "a Git LFS pointer"
PICTURE = "open the scene that was made of such pictures"
UNPACK = "unpack it first"
KINDS = (
    Kind(b"version https://git-lfs.github.com/spec/", LFS_POINTER, "fetch what it stands for: git lfs pull"),
    Kind(b"version https://hawser.github.com/spec/", LFS_POINTER, "fetch what it stands for: git lfs pull"),
    Kind(b"/annex/objects/", "a git-annex pointer", "fetch what it stands for: git annex get"),
    Kind(b"\x89PNG\r\n\x1a\n", "a PNG picture", PICTURE),
    Kind(b"\xff\xd8\xff", "a JPEG picture", PICTURE),
    Kind(b"GIF8", "a GIF picture", PICTURE),
    Kind(b"WEBP", "a WebP picture", "where it is a plane of a SOG, open the meta.json beside it", 8),
    Kind(b"II*\0", "a TIFF picture", PICTURE),
    Kind(b"MM\0*", "a TIFF picture", PICTURE),
    Kind(b"ftyp", "a video or an AVIF or HEIC picture", PICTURE, 4),
    Kind(b"\x1aE\xdf\xa3", "a video", "open the scene that was made of it"),
    Kind(b"%PDF-", "a PDF", "choose another file"),
    Kind(b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    Kind(b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    Kind(b"ustar", "a tar archive", f"{UNPACK}: tar xf", 257),
    Kind(b"\xfd7zXZ\0", "packed with xz", f"{UNPACK}: unxz"),
    Kind(b"BZh", "packed with bzip2", f"{UNPACK}: bunzip2"),
    Kind(b"\x28\xb5\x2f\xfd", "packed with zstd", f"{UNPACK}: unzstd"),
    Kind(b"d8:announce", "a torrent", "open it with a torrent program, which fetches the files"),
    Kind(b"d10:created by", "a torrent", "open it with a torrent program, which fetches the files"),
    Kind(b"d7:comment", "a torrent", "open it with a torrent program, which fetches the files"),
    Kind(b"LASF", "a LAS or LAZ point cloud", "it holds no splats; train a scene from it"),
    Kind(b"ASTM-E57", "an E57 point cloud", "it holds no splats; train a scene from it"),
    Kind(b"Kaydara FBX", "an FBX of meshes", "it holds no splats; choose another file"),
    Kind(b"BLENDER", "a Blender file", "export its splats as PLY"),
    Kind(b"PXR-USDC", "a USD file", "export its splats as PLY"),
    Kind(b"b3dm", "3D Tiles content around a GLB", "open a .glb or .gltf"),
    Kind(b"\x89HDF\r\n\x1a\n", "an HDF5 file", "export its splats as PLY"),
    Kind(b"\x93NUMPY", "a single NumPy array", "a scene is several, in an .npz: numpy.savez"),
    Kind(b"\x7fELF", "a program", "choose another file"),
    Kind(b"SQLite format 3\0", "a database, such as COLMAP's", "open the scene that was trained of it"),
)
"""By their first bytes alone. No scene begins like one of them."""

TEXT_BYTES = 5
"""Fewer bytes may be the beginning of anything."""

PROLOG_CHARS = 200
"""In so many a page says that it is one, behind whatever XML says first."""

_PAGE = re.compile(r"<(!doctype\s+html|html|head|body|script|meta|title|link|style|div)\b", re.IGNORECASE)
_TITLE = re.compile(r"<title[^>]*>([^<]*)</title", re.IGNORECASE)
_XML_CODE = re.compile(r"<Code>([^<]*)</Code", re.IGNORECASE)
_LFS_SIZE = re.compile(rb"\nsize (\d{1,18})\s*$")
_TEXT_BOMS = {b"\xef\xbb\xbf": "utf-8", b"\xff\xfe": "utf-16-le", b"\xfe\xff": "utf-16-be"}
_CONTROLS = bytes(byte for byte in range(32) if byte not in b"\t\n\r\f\x1b") + b"\x7f"


def no_scene(head: bytes, name: str) -> str | None:
    """Return what is wrong with a file of no known format: what it is instead, and what helps; None where unknown.

    Parameters
    ----------
    head : bytes
        What it begins with; the more, the better.
    name : str
        What it is called, for commands to copy.
    """
    for kind in KINDS:
        if head.startswith(kind.magic, kind.place):
            size = _LFS_SIZE.search(head) if kind.what == LFS_POINTER else None
            what = f"{kind.what} to {int(size[1]):,} bytes" if size else kind.what
            return f"is {what}, not the scene itself; {kind.remedy}"
    if re.match(rb"\x80[\x02-\x05]", head) and b"." not in head[:2]:
        return _pickle(head, name)
    text = _text(head)
    return None if text is None else _text_problem(text)


def shown(text: str) -> str:
    """Return the beginning of a text from a file, fit to be quoted in a line."""
    line = " ".join(text.split())
    cut = line if len(line) <= QUOTED_CHARS else f"{line[: QUOTED_CHARS - 3]}..."
    return f"'{printable(cut)}'"


def checkpoint(name: str) -> str:
    """Return what to say of a checkpoint of this name."""
    # The training code of Kerbl et al. 2023 keeps a tuple, without names.
    named_so = name.replace("\\", "/").rpartition("/")[2].startswith("chkpnt")
    return CHECKPOINT + (OF_KERBL if named_so else EXPORT.format(name=printable(name).replace("'", "?")))


def _pickle(head: bytes, name: str) -> str:
    # The number that PyTorch wrote first before it wrote zips.
    if b"\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19" in head[:32]:
        return checkpoint(name)
    return "is a Python pickle, which is not opened, as it may run anything; export its arrays with numpy.savez"


def _text(head: bytes) -> str | None:
    """Return bytes as text, or None where they are none."""
    for bom, encoding in _TEXT_BOMS.items():
        if head.startswith(bom):
            return head[len(bom) :].decode(encoding, "replace")
    if len(head) < TEXT_BYTES or head.translate(None, _CONTROLS) != head:
        return None
    try:
        return head.decode("utf-8", "strict")
    except UnicodeDecodeError as error:
        # The last character may be cut.
        return head[: error.start].decode("utf-8") if error.start >= len(head) - 3 else _latin(head)


def _latin(head: bytes) -> str | None:
    # Pages in other encodings are about; what has no tag at its beginning is taken for binary.
    return head.decode("latin-1") if head.lstrip().startswith(b"<") else None


def _text_problem(text: str) -> str:
    begins = text.lstrip()
    if begins.startswith("<") and _PAGE.search(begins if begins.startswith("<!--") else begins[:PROLOG_CHARS]):
        title = _TITLE.search(text)
        called = f" with the title {shown(title[1])}" if title and title[1].strip() else ""
        return f"is a web page{called}, not the scene itself; download the file that the page links to"
    if begins.startswith("<"):
        code = _XML_CODE.search(text)
        if code:
            return f"is the error {shown(code[1])} of a server, not the scene itself; check address and access"
        return f"is XML, not the scene itself: {shown(begins)}; fetch the file again"
    return f"is text, not the scene itself: {shown(begins)}; fetch the file again"
