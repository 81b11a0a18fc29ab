#!/bin/sh
# Install the system packages that the tests need, or those named, where apt-get can; else say which are missing.
# Without the terminals of tests/e2e, the tests in them are skipped, so their lack alone is no failure.
set -eu

missing=""
terminals=""
need() { # PACKAGE COMMAND
    command -v "$2" >/dev/null 2>&1 || missing="$missing $1"
}
need_terminal() { # PACKAGE COMMAND-OR-FILE
    command -v "$2" >/dev/null 2>&1 || [ -e "$2" ] || terminals="$terminals $1"
}

if [ $# -gt 0 ]; then
    missing="$*"
else
    need libsixel-bin sixel2png # decodes what the sixel encoder wrote
    need_terminal xvfb Xvfb       # a screen without a monitor
    need_terminal xdotool xdotool # and somebody who types in front of it
    need_terminal libgl1-mesa-dri "$(echo /usr/lib/*/dri/swrast_dri.so)"
    need_terminal fonts-dejavu-core /usr/share/fonts/truetype/dejavu/DejaVuSansMono.ttf
    for name in kitty xterm mlterm foot weston alacritty tmux chromium npm; do
        need_terminal "$name" "$name"
    done
fi
[ -n "$missing$terminals" ] || exit 0

if command -v apt-get >/dev/null 2>&1 && [ "$(id -u)" = 0 ]; then
    echo "installing system packages:$missing$terminals" >&2
    apt-get update -qq >&2
    # shellcheck disable=SC2086
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing $terminals >&2
else
    echo "missing system packages; install them first:  sudo apt-get install$missing$terminals" >&2
    [ -z "$missing" ] || exit 1
fi
