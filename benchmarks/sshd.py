"""An sshd of our own on loopback, with keys of its own, gone when it is no longer needed."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from types import TracebackType

START_SECONDS = 10.0


class Sshd:
    """Runs sshd as this user on a free port.

    Parameters
    ----------
    folder : Path
        Where keys and configuration go; an empty folder.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port: int = free.getsockname()[1]

    @staticmethod
    def program() -> str | None:
        """Return where sshd is, None where it is not."""
        return shutil.which("sshd", path=f"{os.environ.get('PATH', '')}:/usr/sbin:/usr/local/sbin")

    def __enter__(self) -> Sshd:
        for name in ("host", "user"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(self._folder / name)]
            subprocess.run(command, check=True)
        if os.geteuid() == 0:
            Path("/run/sshd").mkdir(exist_ok=True)  # where it separates privileges
        configuration = self._folder / "sshd_config"
        configuration.write_text(
            f"Port {self.port}\nListenAddress 127.0.0.1\nHostKey {self._folder}/host\n"
            f"AuthorizedKeysFile {self._folder}/user.pub\nPidFile none\nStrictModes no\nUsePAM no\n"
            "PasswordAuthentication no\nPermitRootLogin prohibit-password\n"
        )
        program = self.program()
        assert program is not None
        with open(self._folder / "log", "wb") as log:
            self._process = subprocess.Popen([program, "-D", "-e", "-f", str(configuration)], stderr=log)
        deadline = time.monotonic() + START_SECONDS
        while self._process.poll() is None and time.monotonic() < deadline:
            with socket.socket() as attempt:
                if attempt.connect_ex(("127.0.0.1", self.port)) == 0:
                    return self
            time.sleep(0.02)
        raise RuntimeError(f"sshd did not start: {(self._folder / 'log').read_text()}")

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        self._process.wait()

    def client(self, port: int, command: str) -> list[str]:
        """Return the command that runs ``command`` over ssh through a port, with a terminal of its own."""
        options = (
            "StrictHostKeyChecking=no", "UserKnownHostsFile=/dev/null", "LogLevel=ERROR", "IdentitiesOnly=yes",
            f"IdentityFile={self._folder}/user", "Compression=no",
        )  # fmt: skip
        flags = [flag for option in options for flag in ("-o", option)]
        return ["ssh", "-F", "none", "-tt", "-p", str(port), *flags, f"{getpass.getuser()}@127.0.0.1", command]
