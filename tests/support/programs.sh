#!/bin/sh
# Fetches programs that some tests run beside the server, from Debian's packages, into .venv/programs. Nothing is
# installed and nothing is started. Where that is not possible those tests are skipped, and say so.
set -u

wanted=
for program in nginx caddy promtool; do
    command -v "$program" >/dev/null 2>&1 && continue
    [ -x ".venv/programs/usr/bin/$program" ] || [ -x ".venv/programs/usr/sbin/$program" ] && continue
    [ "$program" = promtool ] && program=prometheus
    wanted="$wanted $program"
done
[ -z "$wanted" ] && exit 0
command -v apt-get >/dev/null 2>&1 && command -v dpkg-deb >/dev/null 2>&1 || exit 0

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
chmod 755 "$folder"
mkdir -p .venv/programs
programs=$(cd .venv/programs && pwd)
cd "$folder" || exit 0
for package in $wanted; do
    apt-get download -qq "$package" >/dev/null 2>&1 || { apt-get update -qq && apt-get download -qq "$package"; } \
        >/dev/null 2>&1 || { echo "There is no package '$package' here: the tests that run it are skipped."; continue; }
    dpkg-deb -x "$package"_*.deb "$programs"
done
