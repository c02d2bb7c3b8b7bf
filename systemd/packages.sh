#!/usr/bin/env bash
# Builds the program and its Debian package for each architecture that this machine has compilers for.
#
#   systemd/packages.sh [--only amd64|arm64] [--features LIST] [--out DIR]
#
# --only ARCH      one architecture; without it what cannot be built is told and left out
# --features LIST  features beside the default ones, such as can,gpu,gstreamer (arm64 from amd64: without gstreamer)
# --out DIR        where the packages and SHA256SUMS go   [target/package]
#
# Needs cargo, dpkg-deb, strip and readelf (apt install dpkg binutils), and for arm64 on an amd64 machine the compiler and
# the C library of that architecture: apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static. What else
# that takes systemd/cross-aarch64.sh fetches into target/cross. On an arm64 machine only arm64 is built.
set -euo pipefail
# A build that fails in a command substitution ends the script.
shopt -s inherit_errexit
cd "$(dirname "$0")/.."
only= features= out=target/package
while [ $# -gt 0 ]; do
  case $1 in
    --only) only=$2; shift 2 ;;
    --features) features=$2; shift 2 ;;
    --out) out=$2; shift 2 ;;
    *) sed -n '2,12s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
  esac
done
case $only in '' | amd64 | arm64) ;; *) echo "packages.sh: --only $only: give amd64 or arm64" >&2; exit 2 ;; esac

for tool in cargo dpkg-deb dpkg strip readelf gzip; do
  command -v "$tool" >/dev/null || { echo "packages.sh: $tool is not installed: apt install dpkg binutils gzip; cargo from rustup.rs" >&2; exit 1; }
done
native=$(dpkg --print-architecture)
case $native in amd64 | arm64) ;; *) echo "packages.sh: this machine is $native: packages are built on amd64 or arm64" >&2; exit 1 ;; esac

# Why an architecture cannot be built here; nothing if it can.
obstacle() {
  [ "$1" != "$native" ] || return 0
  if [ "$1" = amd64 ]; then
    echo "build it on an amd64 machine"
  elif ! command -v aarch64-linux-gnu-gcc >/dev/null; then
    echo "aarch64-linux-gnu-gcc is not installed: apt install gcc-aarch64-linux-gnu libc6-dev-arm64-cross"
  elif [ "$(. /etc/os-release; echo "${ID:-} ${VERSION_ID:-}")" != "debian 12" ]; then
    echo "systemd/cross-aarch64.sh needs Debian 12"
  fi
}

targets=${CARGO_TARGET_DIR:-target}
build() { # ARCH
  if [ "$1" = "$native" ]; then
    cargo build --release --locked -p lookout --bin lookout ${features:+--features "$features"} >&2
    echo "$targets/release/lookout"
  else
    systemd/cross-aarch64.sh build ${features:+--features "$features"} >&2
    echo "${CROSS_TARGET_DIR:-target/cross/build}/aarch64-unknown-linux-gnu/release/lookout"
  fi
}

# The program for this machine comes first: it writes the manual pages and completions of all packages.
order=$native
if [ "$native" = amd64 ]; then order="amd64 arm64"; else order="arm64 amd64"; fi
tool= packages=()
for arch in $order; do
  reason=$(obstacle "$arch")
  if [ -n "$only" ] && [ "$arch" != "$only" ]; then
    [ "$arch" != "$native" ] || tool=$(build "$arch")
    continue
  fi
  if [ -n "$reason" ]; then
    echo "packages.sh: $arch left out: $reason" >&2
    [ -z "$only" ] || exit 1
    continue
  fi
  binary=$(build "$arch")
  tool=${tool:-$binary}
  packages+=("$(systemd/package.sh --binary "$binary" --tool "$tool" ${features:+--features "$features"} --out "$out")")
done
(cd "$out" && sha256sum -- *.deb >SHA256SUMS)
printf '%s\n' "${packages[@]}" "$out/SHA256SUMS"
