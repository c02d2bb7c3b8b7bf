#!/usr/bin/env bash
# The Debian package for arm64 on another machine: installed, run and purged in a clean root, under emulation.
#
#   tests/systemd/arm64.sh FILE.deb ROOT
#
# ROOT is a folder made by: debootstrap --arch=arm64 --variant=minbase --include=systemd,passwd bookworm ROOT
# Needs root, and programs for arm64 that start by themselves (packages qemu-user-static and binfmt-support). Ends with
# "passed" and exit code 0 when the package installed, all processes of a replay came up and gave every pair,
# and the purge left no file behind.
set -euo pipefail
[ $# -eq 2 ] || { sed -n '2,9s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ "$(id -u)" -eq 0 ] || { echo "arm64.sh: run me as root" >&2; exit 2; }
[ -f "$1" ] || { echo "arm64.sh: $1 is not there: systemd/package.sh makes it" >&2; exit 2; }
[ -x "$2/usr/bin/apt-get" ] || { echo "arm64.sh: $2 is no root of Debian: debootstrap makes it" >&2; exit 2; }
package=$(realpath "$1") root=$(realpath "$2")
work=$(mktemp -d)
clean() {
  umount "$root/dev/shm" "$root/proc" 2>/dev/null || true
  rm -rf "$work" "$root/tmp/lookout.deb"
}
trap clean EXIT

inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive "$@"; }
# Caches and logs of apt itself are not the package's.
files() {
  find "$root" -xdev \( -path "$root/proc" -o -path "$root/dev" -o -path "$root/var/cache/apt" -o -path "$root/var/lib/apt" \
    -o -path "$root/var/log" -o -path "$root/tmp" \) -prune -o -print | sort
}
machine=$(inside uname -m) || { echo "arm64.sh: programs of $root do not start: is qemu-user-static registered?" >&2; exit 2; }
[ "$machine" = aarch64 ] || { echo "arm64.sh: $root is for $machine" >&2; exit 2; }
mount -t proc proc "$root/proc"
mkdir -p "$root/dev/shm"
mount -t tmpfs tmpfs "$root/dev/shm"
cp "$package" "$root/tmp/lookout.deb"

files >"$work/before"
inside apt-get install -qq -y --no-install-recommends /tmp/lookout.deb
inside lookout --version
inside lookout check-config rpi5 >/dev/null
inside lookout replay scene:street --fps 2 --limit 12 | tee "$work/replay"
grep -q '^12 of 12 pairs' "$work/replay"
[ -z "$(ls "$root/dev/shm")" ] || { echo "arm64.sh: shared memory was left: $(ls "$root/dev/shm")" >&2; exit 1; }
inside apt-get purge -qq -y lookout
files >"$work/after"
diff "$work/before" "$work/after"
! grep lookout "$root/etc/passwd" "$root/etc/group"
echo passed
