#!/bin/sh
# Makes sure that the machine has a Chromium for the browser tests; the names are those of tests/support/chromium.py.
set -eu

for name in chromium chromium-browser google-chrome google-chrome-stable chrome; do
    command -v "$name" >/dev/null 2>&1 && exit 0
done

if [ "$(id -u)" = 0 ]; then
    sudo=
elif sudo -n true 2>/dev/null; then
    sudo="sudo -n"
else
    sudo=none
fi

if [ "$sudo" = none ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "The browser tests need Chromium or Chrome, and this machine has none." >&2
    echo "Install one (Debian: apt-get install chromium) so that 'chromium' or 'google-chrome' is on the PATH." >&2
    exit 1
fi

echo "The browser tests need Chromium: installing Debian's package 'chromium' ..."
log=$(mktemp)
trap 'rm -f "$log"' EXIT
if ! { $sudo apt-get update -qq && $sudo env DEBIAN_FRONTEND=noninteractive \
        apt-get install -y -qq --no-install-recommends chromium; } >"$log" 2>&1; then
    cat "$log" >&2
    echo "Installing Chromium failed." >&2
    exit 1
fi
echo "Installed."
