#!/bin/sh
# Install the system packages that the tests need, or those named, where apt-get can; else say which are missing.
set -eu

missing=""
need() { # PACKAGE COMMAND
    command -v "$2" >/dev/null 2>&1 || missing="$missing $1"
}

if [ $# -gt 0 ]; then
    missing="$*"
else
    need libsixel-bin sixel2png # decodes what the sixel encoder wrote
    need tmux tmux              # a real terminal for the viewer
fi
[ -n "$missing" ] || exit 0

if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing system packages:$missing" >&2
    apt-get update -qq >&2
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing >&2
else
    echo "missing system packages; install them first:  sudo apt-get install$missing" >&2
    exit 1
fi
