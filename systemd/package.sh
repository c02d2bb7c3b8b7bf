#!/usr/bin/env bash
# Makes the Debian package, out of a binary that is already built.
#
#   systemd/package.sh [--binary FILE] [--tool FILE] [--features LIST] [--library DIR] [--out DIR]
#
# --binary FILE  the program that is packaged, for amd64 or arm64     [target/release/lookout]
# --tool FILE    the same version for this machine: it writes manual pages and completions [the binary]
# --features LIST  the features with which the program was built, beside the default ones: what they link in is listed
#                in the package's copyright; with gpu and gstreamer the service gets the devices of GPUs and CSI cameras [none]
# --library DIR  where liblookout.so and liblookout.a of the same machine are (cargo build --release -p lookout-client-c): makes
#                the package lookout-dev, too: header, libraries, pkg-config file, examples            [none]
# --out DIR      where the package goes                               [target/package]
#
# Needs cargo with the crates of the build, dpkg-deb, strip (for arm64, aarch64-linux-gnu-strip), readelf and gzip.
# Prints the packages' paths.
# For arm64: systemd/cross-aarch64.sh builds the binary.
set -euo pipefail
cd "$(dirname "$0")/.."
binary=target/release/lookout tool= features= library= out=target/package
while [ $# -gt 0 ]; do
  case $1 in
    --binary) binary=$2; shift 2 ;;
    --tool) tool=$2; shift 2 ;;
    --features) features=$2; shift 2 ;;
    --library) library=$2; shift 2 ;;
    --out) out=$2; shift 2 ;;
    *) sed -n '2,17s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
  esac
done
tool=${tool:-$binary}
[ -x "$binary" ] || { echo "package.sh: $binary is not there: cargo build --release" >&2; exit 1; }

case $(readelf -h "$binary" | sed -n 's/ *Machine: *//p') in
  *X86-64*) arch=amd64 triple=x86_64-unknown-linux-gnu strip=strip ;;
  AArch64) arch=arm64 triple=aarch64-unknown-linux-gnu strip=aarch64-linux-gnu-strip ;;
  *) echo "package.sh: $binary is for no known machine" >&2; exit 1 ;;
esac
if [ "$arch" = "$(dpkg --print-architecture)" ]; then strip=strip; fi
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -1)
# A package with features is another one, and newer than that without: 0.1.0+gpu.gstreamer.
built_with=$(tr ', ' '\n\n' <<<"$features" | sed '/^$/d' | sort -u | paste -sd.)
version=$version${built_with:++$built_with}
has() { [[ .$built_with. == *."$1".* ]]; }
# What the binary asks of the C library.
libc=$(readelf --version-info "$binary" | grep -o 'GLIBC_[0-9.]*' | sort -uV | tail -1)
libc=${libc#GLIBC_}
date=$(git log -1 --format=%cD 2>/dev/null || date -R)
export SOURCE_DATE_EPOCH=${SOURCE_DATE_EPOCH:-$(date -d "$date" +%s)}

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
chmod 755 "$root"
put() { install -D -m 644 "$1" "$root/$2"; } # FILE TO
text() { put "$1" "$2"; gzip -9nf "$root/$2"; }

install -D -m 755 "$binary" "$root/usr/bin/lookout"
"$strip" --strip-unneeded --remove-section=.comment "$root/usr/bin/lookout"
for unit in lookout.service lookout-view.service lookout-can.service lookout-stream.service lookout-bridge.service lookout-poweroff.service lookout-poweroff.path; do
  put "systemd/$unit" "usr/lib/systemd/system/$unit"
done
put systemd/lookout.sysusers usr/lib/sysusers.d/lookout.conf
put systemd/lookout.tmpfiles usr/lib/tmpfiles.d/lookout.conf
put systemd/70-lookout.rules usr/lib/udev/rules.d/70-lookout.rules
depends= recommends=
if has gpu; then
  put systemd/gpu.conf usr/lib/systemd/system/lookout.service.d/50-gpu.conf
  put systemd/gpu.sysusers usr/lib/sysusers.d/lookout-gpu.conf
  depends=$depends', libvulkan1' recommends='mesa-vulkan-drivers | vulkan-icd'
fi
if has gstreamer; then
  put systemd/csi.conf usr/lib/systemd/system/lookout.service.d/50-csi.conf
  put systemd/71-lookout-csi.rules usr/lib/udev/rules.d/71-lookout-csi.rules
  depends=$depends', libglib2.0-0 | libglib2.0-0t64, libgstreamer1.0-0, libgstreamer-plugins-base1.0-0, gstreamer1.0-plugins-base'
  recommends=${recommends:+$recommends, }'gstreamer1.0-plugins-good, gstreamer1.0-libcamera'
fi
put systemd/lookout.toml etc/lookout/lookout.toml
for profile in config/profiles/*.toml; do
  put "$profile" "usr/share/lookout/profiles/$(basename "$profile")"
done
put config/can/lookout.dbc usr/share/lookout/lookout.dbc
put models/vehicle.xml usr/share/lookout/models/vehicle.xml
put models/objects.onnx usr/share/lookout/models/objects.onnx
put models/objects-free.onnx usr/share/lookout/models/objects-free.onnx
put models/people.hog usr/share/lookout/models/people.hog
put models/README.md usr/share/lookout/models/README.md
put models/LICENSE usr/share/doc/lookout/models-license
text README.md usr/share/doc/lookout/README.md
for page in tutorial recorded-data troubleshooting inputs cameras tracking operations configuration architecture calibration outputs scenes viewer can fleet; do
  text "docs/$page.md" "usr/share/doc/lookout/$page.md"
done
put docs/pictures/chessboard-9x6-25mm.svg usr/share/doc/lookout/pictures/chessboard-9x6-25mm.svg

"$tool" man "$root/usr/share/man/man1"
gzip -9n "$root"/usr/share/man/man1/*
chmod 644 "$root"/usr/share/man/man1/*
complete() { mkdir -p "$(dirname "$root/$2")"; "$tool" completions "$1" >"$root/$2"; }
complete bash usr/share/bash-completion/completions/lookout
complete zsh usr/share/zsh/vendor-completions/_lookout
complete fish usr/share/fish/vendor_completions.d/lookout.fish

# The terms of everything that is linked in, too.
cargo run --quiet --release --locked -p debian-copyright -- \
  --target "$triple" --features "$features" >"$root/usr/share/doc/lookout/copyright"
printf 'lookout (%s) unstable; urgency=medium\n\n  * As docs/ and README.md describe.\n\n -- The lookout project <lookout@lookout.invalid>  %s\n' \
  "$version" "$date" | gzip -9n >"$root/usr/share/doc/lookout/changelog.gz"

mkdir "$root/DEBIAN"
echo /etc/lookout/lookout.toml >"$root/DEBIAN/conffiles"
cat >"$root/DEBIAN/control" <<EOF
Package: lookout
Version: $version
Architecture: $arch
Maintainer: The lookout project <lookout@lookout.invalid>
Installed-Size: $(du -sk --exclude=DEBIAN "$root" | cut -f1)
Depends: libc6 (>= $libc), libgcc-s1, passwd, systemd | systemd-standalone-sysusers$depends
${recommends:+Recommends: $recommends
}Section: misc
Priority: optional
Description: watches the road ahead of a vehicle with two cameras
 Turns stereo pairs into a dense disparity map, a road model, obstacles and
 alarms, in separate processes that hand each other frames through shared
 memory without a copy. Made for small ARM boards.
 .
 An aid, not a safety element: it actuates nothing and is not certified. The
 weights that come along are for research and non-commercial use.
EOF
cat >"$root/DEBIAN/postinst" <<'EOF'
#!/bin/sh
set -e
if [ "$1" = configure ]; then
  for users in lookout.conf lookout-gpu.conf; do
    if [ -e "/usr/lib/sysusers.d/$users" ]; then systemd-sysusers "$users"; fi
  done
  if command -v systemd-tmpfiles >/dev/null; then
    systemd-tmpfiles --create lookout.conf || true
  fi
  if command -v udevadm >/dev/null && [ -S /run/udev/control ]; then
    udevadm control --reload || true
    udevadm trigger --subsystem-match=video4linux --subsystem-match=devfreq --subsystem-match=dma_heap || true
  fi
  if [ -d /run/systemd/system ]; then
    systemctl daemon-reload || true
    if [ -n "$2" ]; then
      systemctl try-restart lookout.service lookout-view.service lookout-can.service lookout-stream.service lookout-bridge.service || true
    fi
  fi
fi
EOF
cat >"$root/DEBIAN/prerm" <<'EOF'
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
  systemctl disable --now lookout-view.service lookout-can.service lookout-stream.service lookout-bridge.service lookout.service lookout-poweroff.path || true
fi
EOF
cat >"$root/DEBIAN/postrm" <<'EOF'
#!/bin/sh
set -e
if [ "$1" = purge ]; then
  rm -rf /etc/lookout /var/lib/lookout /var/lib/lookout-bridge /var/cache/lookout /run/lookout
  if getent passwd lookout >/dev/null; then
    userdel lookout || true
  fi
  for group in lookout lookout-readers; do
    if getent group "$group" >/dev/null; then
      groupdel "$group" || true
    fi
  done
fi
if [ "$1" != upgrade ] && [ -d /run/systemd/system ]; then
  systemctl daemon-reload || true
fi
EOF
chmod 755 "$root"/DEBIAN/p*
finish() { # ROOT NAME
  (cd "$1" && find . -type f ! -path './DEBIAN/*' -printf '%P\0' | sort -z | xargs -0 md5sum >DEBIAN/md5sums)
  find "$1" -type d -exec chmod 755 {} +
  find "$1" -type f ! -perm 755 -exec chmod 644 {} +
  find "$1" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
  mkdir -p "$out"
  # One package of a name: with other features it has another version.
  rm -f "$out/$2"_*_"$arch.deb"
  local package=$out/$2_${version}_$arch.deb
  dpkg-deb --root-owner-group -Zxz --build "$1" "$package" >/dev/null
  echo "$package"
}
finish "$root" lookout
[ -n "$library" ] || exit 0

case $(readelf -h "$library/liblookout.so" | sed -n 's/ *Machine: *//p') in
  *X86-64*) built=amd64 ;;
  AArch64) built=arm64 ;;
  *) built=unknown ;;
esac
[ "$built" = "$arch" ] || { echo "package.sh: $library/liblookout.so is for $built, the program for $arch" >&2; exit 1; }
dev=$root/.dev
mkdir -p "$dev/DEBIAN"
DESTDIR=$dev clients/c/install.sh /usr "$library"
"$strip" --strip-unneeded --remove-section=.comment "$dev"/usr/lib/liblookout.so.*
chmod 644 "$dev"/usr/lib/liblookout.so.*
"$strip" --strip-debug --enable-deterministic-archives "$dev/usr/lib/liblookout.a"
doc=$dev/usr/share/doc/lookout-dev
mkdir -p "$doc/examples"
cp clients/c/examples/*.c "$doc/examples/"
for page in clients client-records; do gzip -9n <"docs/$page.md" >"$doc/$page.md.gz"; done
cp "$root/usr/share/doc/lookout/copyright" "$root/usr/share/doc/lookout/changelog.gz" "$doc/"
cat >"$dev/DEBIAN/control" <<EOF
Package: lookout-dev
Source: lookout
Version: $version
Architecture: $arch
Maintainer: The lookout project <lookout@lookout.invalid>
Installed-Size: $(du -sk --exclude=DEBIAN "$dev" | cut -f1)
Depends: libc6 (>= $libc), libgcc-s1
Recommends: lookout (= $version)
Section: libdevel
Priority: optional
Description: reads the results of lookout from shared memory (C library)
 Header, shared and static library, and the file for pkg-config. Library and
 daemon must be of one release.
EOF
finish "$dev" lookout-dev
