#!/usr/bin/env bash
# Installs the C library: clients/c/install.sh PREFIX [FOLDER]. FOLDER has liblookout.so and liblookout.a, by default what
# `cargo build --release -p lookout-client-c` has built. DESTDIR is respected.
set -euo pipefail
[ $# -ge 1 ] || { sed -n 2,3p "$0"; exit 2; }
here=$(cd "$(dirname "$0")" && pwd)
prefix=$1 built=${2:-$here/../../target/release} root=${DESTDIR:-}$1
version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$here/../../Cargo.toml" | head -1)
layout=$(sed -n 's/^#define LOOKOUT_LAYOUT //p' "$here/include/lookout.h")
install -d "$root/include" "$root/lib/pkgconfig"
install -m 644 "$here/include/lookout.h" "$root/include/lookout.h"
install -m 755 "$built/liblookout.so" "$root/lib/liblookout.so.$layout"
ln -sf "liblookout.so.$layout" "$root/lib/liblookout.so"
install -m 644 "$built/liblookout.a" "$root/lib/liblookout.a"
sed -e "s#@prefix@#$prefix#" -e "s#@version@#$version#" "$here/lookout.pc.in" > "$root/lib/pkgconfig/lookout.pc"
