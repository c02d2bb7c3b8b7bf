#!/usr/bin/env bash
# Second half of boot.sh, inside the namespaces: builds the root, and becomes systemd.
set -eu
mount -t tmpfs tmpfs "$work/m"
root=$work/m/root
mkdir -p "$work/m/upper" "$work/m/work" "$root"
mount -t overlay overlay -o "lowerdir=$lower,upperdir=$work/m/upper,workdir=$work/m/work" "$root"
mount -t proc proc "$root/proc"
mount --rbind /dev "$root/dev"
mount -t tmpfs tmpfs "$root/dev/shm"
: >"$work/out/console"
[ -e "$root/dev/console" ] || mknod "$root/dev/console" c 5 1
mount --bind "$work/out/console" "$root/dev/console"
mount -t sysfs -o ro sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
mount -t tmpfs tmpfs "$root/run"
mount -t tmpfs tmpfs "$root/tmp"
mount --bind "$root/proc/sys" "$root/proc/sys"
mount -o remount,ro,bind "$root/proc/sys"
mkdir -p "$root/opt/test/out"
cp "$tests/inside.sh" "$root/opt/test/"
mount --bind "$work/out" "$root/opt/test/out"
if [ -n "$package" ]; then
  cp "$package" "$root/opt/test/lookout.deb"
else
  # As the package puts it there.
  install -m 755 "$binary" "$root/usr/bin/lookout"
  install -m 644 -D "$units/lookout.toml" "$root/etc/lookout/lookout.toml"
  install -m 644 "$units"/*.service "$units"/*.path "$root/etc/systemd/system/"
  install -m 644 -D "$units/lookout.sysusers" "$root/usr/lib/sysusers.d/lookout.conf"
  install -m 644 -D "$units/lookout.tmpfiles" "$root/usr/lib/tmpfiles.d/lookout.conf"
fi
cat >"$root/etc/systemd/system/lookout-test.target" <<'UNIT'
[Unit]
Description=Test of lookout
Requires=basic.target lookout-test.service
After=basic.target lookout-test.service
AllowIsolate=yes
UNIT
cat >"$root/etc/systemd/system/lookout-test.service" <<'UNIT'
[Unit]
Description=Test of lookout
After=basic.target
SuccessAction=exit
FailureAction=exit-force
[Service]
Type=oneshot
StandardOutput=file:/opt/test/out/report
StandardError=file:/opt/test/out/report
TimeoutStartSec=infinity
ExecStart=/bin/bash /opt/test/inside.sh
UNIT
: >"$root/etc/machine-id"
hostname lookout-test
cd "$root"
mkdir -p old
pivot_root . old
umount -l /old
exec env -i container=other PATH=/usr/sbin:/usr/bin:/sbin:/bin SYSTEMD_LOG_TARGET=kmsg \
  /lib/systemd/systemd --system --unit=lookout-test.target --log-target=console --log-level=info --show-status=no </dev/null
