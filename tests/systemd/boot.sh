#!/usr/bin/env bash
# Boots this machine's own systemd as process 1 of new namespaces, over a throw-away copy of /, and runs
# tests/systemd/inside.sh in it: the units for real, without touching this machine.
#
#   tests/systemd/boot.sh [BINARY]                 default: target/release/lookout
#   tests/systemd/boot.sh --package FILE.deb ROOT  the package in ROOT, a folder made by debootstrap
#
# Needs root, systemd 252 or later, and a kernel with namespaces, overlayfs and cgroup 2. Exit code 0 and a last
# line "passed" when all went well; else what went wrong and the log of that systemd. Not there: cgroup
# controllers, and limits above those of this machine.
set -euo pipefail
cd "$(dirname "$0")/../.."
if [ "${1:-}" = --package ]; then
  package=$(realpath "$2") lower=$(realpath "$3") binary=
else
  package= lower=/ binary=$(realpath "${1:-target/release/lookout}")
fi
[ "$(id -u)" -eq 0 ] || { echo "boot.sh: run me as root" >&2; exit 2; }

work=$(mktemp -d)
units=$PWD/systemd tests=$PWD/tests/systemd
mkdir -p "$work/m" "$work/out"
group=/sys/fs/cgroup/unified
[ -d "$group" ] || group=/sys/fs/cgroup
group=$group/lookout-boot-$$
mkdir -p "$group"
clean() {
  rmdir "$group"/*/ "$group" 2>/dev/null || true
  rm -rf "$work"
}
trap clean EXIT
export package lower binary work units tests

# In a group of its own, so that the systemd inside sees an empty tree.
code=0
timeout "${BOOT_SECONDS:-420}" bash -c '
  echo $$ >"$0/cgroup.procs"
  exec unshare --mount --pid --fork --ipc --uts --cgroup --net --propagation private --kill-child bash "$tests/root.sh"
' "$group" </dev/null || code=$?
cat "$work/out/report" 2>/dev/null || true
if [ "$code" -ne 0 ] || ! grep -qx passed "$work/out/report" 2>/dev/null; then
  echo "--- the log of that systemd (exit code $code)" >&2
  tail -n 200 "$work/out/console" >&2 || true
  exit 1
fi
