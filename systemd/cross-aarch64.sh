#!/usr/bin/env bash
# Builds lookout for 64-bit ARM on a Debian 12 amd64 machine, and runs the kernels' tests under emulation.
#
#   systemd/cross-aarch64.sh prepare    a compiler with ARM libraries into target/cross (130 MB, once)
#   systemd/cross-aarch64.sh build      target/cross/build/aarch64-unknown-linux-gnu/release/lookout
#   systemd/cross-aarch64.sh libraries  matching and rectifying as libraries, for tests/board/counted.py
#   systemd/cross-aarch64.sh test [ARGS of cargo test]   kernels (perception) by default
#   systemd/cross-aarch64.sh test-armv7 [ARGS of cargo test]   the same on 32-bit ARM, whose kernels are plain
#   systemd/cross-aarch64.sh check-armv7 [ARGS of cargo check]   whether 32-bit ARM compiles; perception by default
#   systemd/cross-aarch64.sh userland FOLDER   the program in a foreign userland that was unpacked there
#                                       (debootstrap --foreign --arch=arm64), under emulation
#
# Needs root's packages gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static, for 32 bits
# gcc-arm-linux-gnueabihf libc6-dev-armhf-cross. The compiler is
# Debian's own rustc-web, unpacked, not installed: nothing of the system changes. Its libraries do not fit
# other compilers. build prints the newest glibc that the program asks for: Debian 12 has 2.36, Ubuntu 22.04 2.35.
set -euo pipefail
cd "$(dirname "$0")/.."
cross=$PWD/target/cross
target=aarch64-unknown-linux-gnu

prepare() {
  [ -x "$cross/rustc" ] && return
  mkdir -p "$cross"/{lists/partial,cache/archives/partial,sources,packages,root}
  : >"$cross/status"
  cat >"$cross/sources/debian.list" <<'LIST'
deb http://deb.debian.org/debian bookworm main
deb http://deb.debian.org/debian bookworm-updates main
deb http://deb.debian.org/debian-security bookworm-security main
LIST
  # Where this machine gets its own packages, if it says so in the usual file.
  if [ -e /etc/apt/sources.list.d/debian.sources ]; then
    rm "$cross/sources/debian.list"
    cp /etc/apt/sources.list.d/debian.sources "$cross/sources/"
  fi
  local apt=(apt-get -qq -o "Dir::State::Lists=$cross/lists" -o "Dir::State::status=$cross/status"
    -o "Dir::Cache=$cross/cache" -o Dir::Etc::sourcelist=/dev/null -o "Dir::Etc::sourceparts=$cross/sources"
    -o Acquire::Languages=none -o APT::Architecture=amd64 -o APT::Architectures::=amd64
    -o APT::Architectures::=arm64 -o APT::Sandbox::User=root)
  "${apt[@]}" update
  (cd "$cross/packages" && "${apt[@]}" download rustc-web:amd64 libllvm22:amd64 libstd-rust-web-1.96:amd64 \
    libstd-rust-web-dev:amd64 libstd-rust-web-dev:arm64)
  for package in "$cross"/packages/*.deb; do
    dpkg-deb -x "$package" "$cross/root"
  done
  cat >"$cross/rustc" <<WRAPPER
#!/bin/sh
exec env LD_LIBRARY_PATH=$cross/root/usr/lib/x86_64-linux-gnu $cross/root/usr/bin/rustc "\$@"
WRAPPER
  chmod +x "$cross/rustc"
}

# The ARM libraries of 32 bits: from the pool, as their index lags behind at times.
prepare_armv7() {
  [ -d "$cross/root/usr/lib/rustlib/armv7-unknown-linux-gnueabihf" ] && return
  local package
  package=$(basename "$cross"/packages/libstd-rust-web-dev_*_arm64.deb _arm64.deb)_armhf.deb
  /usr/lib/apt/apt-helper -q download-file \
    "http://deb.debian.org/debian-security/pool/updates/main/r/rustc-web/$package" "$cross/packages/$package"
  dpkg-deb -x "$cross/packages/$package" "$cross/root"
}

export RUSTC=$cross/rustc CARGO_TARGET_DIR=${CROSS_TARGET_DIR:-$cross/build}
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
export CARGO_TARGET_ARMV7_UNKNOWN_LINUX_GNUEABIHF_LINKER=arm-linux-gnueabihf-gcc
export CARGO_TARGET_ARMV7_UNKNOWN_LINUX_GNUEABIHF_RUNNER="qemu-arm-static -L /usr/arm-linux-gnueabihf"
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64-static -L ${USERLAND:-/usr/aarch64-linux-gnu}"

case ${1:-} in
  prepare)
    prepare
    "$cross/rustc" --version
    ;;
  build)
    prepare
    shift
    cargo build --release --locked --target $target -p lookout "$@"
    readelf --version-info "$CARGO_TARGET_DIR/$target/release/lookout" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -1
    ;;
  libraries)
    prepare
    cargo build --release --locked --target $target -p lookout-perception --example stereo_library --example remap_library
    ls "$CARGO_TARGET_DIR/$target/release/examples/"lib{stereo,remap}_library.so
    ;;
  test)
    prepare
    shift
    [ $# -gt 0 ] || set -- -p lookout-perception --lib
    cargo test --release --locked --target $target "$@"
    ;;
  test-armv7)
    prepare
    prepare_armv7
    shift
    [ $# -gt 0 ] || set -- -p lookout-perception --lib
    cargo test --release --locked --target armv7-unknown-linux-gnueabihf "$@"
    ;;
  check-armv7)
    prepare
    prepare_armv7
    shift
    [ $# -gt 0 ] || set -- -p lookout-perception
    cargo check --locked --target armv7-unknown-linux-gnueabihf "$@"
    ;;
  userland)
    # Its own loader and C library, as on the board.
    binary=$CARGO_TARGET_DIR/$target/release/lookout
    grep -h PRETTY_NAME "$2/etc/os-release" || true
    qemu-aarch64-static -L "$2" "$binary" --version
    qemu-aarch64-static -L "$2" "$binary" replay scene:street --in-process --limit 3
    ;;
  *)
    sed -n '2,17s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac
