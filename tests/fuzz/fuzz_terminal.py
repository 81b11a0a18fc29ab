"""Coverage-guided fuzzing of what a terminal sends: answers, keys, sizes. Needs `pip install atheris`.

    python -m tests.fuzz.fuzz_terminal corpus/terminal -max_total_time=600

All words are libFuzzer's. Of an input the first byte says in how large pieces the rest comes.
"""

from __future__ import annotations

import hashlib
import sys
import zlib
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["tsplat.terminal", "tsplat.viewer.update", "tsplat.viewer.motion"]):
    from tests.terminal.outcomes import WINDOWS, outcome
    from tests.terminal.test_parser import SEQUENCES
    from tests.terminal.test_probe import CASES

DEFAULTS = (
    "-timeout=10",
    "-rss_limit_mb=2048",
    "-max_len=8192",
    "-len_control=0",
    "-print_final_stats=1",
    "-detect_leaks=0",
)


def main() -> None:
    arguments = sys.argv[1:]
    corpora = [Path(word) for word in arguments if not word.startswith("-") and not Path(word).is_file()]
    for raw in [*SEQUENCES, *(case.replies for case in CASES)]:
        for corpus in corpora:
            corpus.mkdir(parents=True, exist_ok=True)
            (corpus / hashlib.sha1(raw).hexdigest()).write_bytes(b"\x40" + raw)

    def test_one(raw: bytes) -> None:
        outcome(raw, WINDOWS[zlib.crc32(raw) % len(WINDOWS)])

    atheris.Setup([sys.argv[0], *DEFAULTS, *arguments], test_one)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
