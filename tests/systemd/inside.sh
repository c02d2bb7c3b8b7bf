#!/usr/bin/env bash
# Runs inside the systemd that boot.sh boots: the service from installation to its last trace.
set -euo pipefail
say() { echo "$*"; }
fail() {
  echo "FAILED: $*"
  systemctl status lookout --no-pager -l || true
  journalctl -u lookout -u lookout-poweroff.service --no-pager -o short-monotonic -n 80 || true
  exit 1
}
logged() { journalctl -u lookout --no-pager -o cat | grep -q "$1"; }
show() { systemctl show lookout --property "$1" --value; }
# Waits until a command succeeds.
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    [ "$SECONDS" -lt "$until" ] || fail "$what"
    sleep 0.2
  done
}
# Of the daemon: without the server of the socket.
processes() {
  # Those beside the daemon do not count.
  local beside
  beside=$(systemctl is-active lookout-stream lookout-view | grep -cx active || true)
  echo $(($(readlink /proc/[0-9]*/exe | grep -c '^/usr/bin/lookout') - beside))
}
as_user() { setpriv --reuid lookout --regid lookout --init-groups "$@"; }
says() { as_user lookout status 2>/dev/null | grep -q "$1"; }

# A board whose files can be written: the kernel's own are read-only here.
sys=/opt/test/sys
zone=$sys/class/thermal/thermal_zone0 policy=$sys/devices/system/cpu/cpufreq/policy0
mkdir -p "$zone" "$policy"
echo cpu-thermal >"$zone/type"
echo 60000 >"$zone/temp"
echo 600000 >"$policy/scaling_min_freq"
echo 2400000 | tee "$policy/scaling_max_freq" >"$policy/scaling_cur_freq"
clocks() { echo "$(cat "$policy/scaling_min_freq")-$(cat "$policy/scaling_max_freq")"; }

if [ -e /opt/test/lookout.deb ]; then
  find / -xdev \( -path /proc -o -path /sys -o -path /opt/test -o -path /run \) -prune -o -print | sort >/run/before
  apt-get install -y --no-install-recommends /opt/test/lookout.deb >/run/apt.log 2>&1 || { cat /run/apt.log; fail "the package does not install"; }
  say "installed: $(dpkg-query -W lookout)"
  for file in /usr/bin/lookout /usr/share/man/man1/lookout.1.gz /usr/share/man/man1/lookout-run.1.gz \
    /usr/share/bash-completion/completions/lookout /usr/share/doc/lookout/operations.md.gz \
    /usr/share/lookout/profiles/tk1.toml /usr/share/lookout/models/vehicle.xml \
    /usr/share/lookout/models/objects.onnx; do
    [ -e "$file" ] || fail "$file is not in the package"
  done
  for part in 'crates/iceoryx2-[0-9.]*' 'crates/zstd-sys-.*/zstd' 'crates/lz4-sys-.*/lz4'; do
    grep -q "^Files: $part/\*$" /usr/share/doc/lookout/copyright || fail "the copyright does not list $part"
  done
  systemctl is-enabled --quiet lookout && fail "it is enabled before it was configured"
  as_user lookout replay scene:street --limit 30 --lockstep --json >/run/replay.json || fail "replay"
  grep -q '"frames": 30' /run/replay.json || fail "replay: $(cat /run/replay.json)"
  say "replayed 30 frames of a scene in lock-step"
else
  systemd-sysusers
  systemd-tmpfiles --create /usr/lib/tmpfiles.d/lookout.conf
fi
id lookout

mkdir -p /etc/systemd/system/lookout.service.d /etc/systemd/system/lookout-poweroff.service.d
# The made-up board may be written, the watchdog bites sooner.
cat >/etc/systemd/system/lookout.service.d/test.conf <<'UNIT'
[Service]
ReadWritePaths=/opt/test/sys
WatchdogSec=8
UNIT
# What would switch off.
cat >/etc/systemd/system/lookout-poweroff.service.d/test.conf <<'UNIT'
[Service]
ReadWritePaths=/opt/test
ExecStart=
ExecStart=/bin/cp /run/lookout/power-off /opt/test/off
ExecStart=/bin/rm -f /run/lookout/power-off
ExecStart=/bin/systemctl --no-block start lookout-asked.service
UNIT
# Shows that systemctl reaches systemd from that unit.
cat >/etc/systemd/system/lookout-asked.service <<'UNIT'
[Service]
Type=oneshot
ExecStart=/bin/touch /opt/test/asked
UNIT
cp /etc/lookout/lookout.toml /run/lookout.toml
cat >/etc/lookout/lookout.toml <<TOML
[board]
sysfs = "$sys"
power_off = "request"
[heat]
watch = "require"
dwell_s = 0.1
[clocks]
set = "require"
cpu_mhz = 2400
[stereo]
disparities = 64
TOML
chgrp -R lookout "$sys" && chmod -R g+w "$sys"
systemctl daemon-reload

systemctl start lookout lookout-poweroff.path || fail "it does not start"
[ "$(show ActiveState)" = active ] || fail "not active"
say "started: READY came; NotifyAccess=$(show NotifyAccess), status: $(show StatusText)"
wait_for 20 "no status" says ": running"
as_user lookout status
pid=$(show MainPID)
say "user $(stat -c %U /proc/"$pid"), capabilities $(grep CapEff /proc/"$pid"/status | cut -f2), clocks $(clocks)"
[ "$(stat -c %U /proc/"$pid")" = lookout ] || fail "it runs as another user"
[ "$(clocks)" = 2400000-2400000 ] || fail "clocks were not set: $(clocks)"

echo '[alarm]
distance_m = 12' >>/etc/lookout/lookout.toml
systemctl reload lookout
wait_for 20 "the reload was not told" logged 'changed: alarm.distance_m'
wait_for 20 "it does not run after the reload" says ": running"
[ "$(show MainPID)" = "$pid" ] || fail "the reload restarted it"
say "reloaded: alarm.distance_m, the same process"

[ -e /run/systemd/system/lookout-stream.service ] || [ -e /usr/lib/systemd/system/lookout-stream.service ] ||
  [ -e /etc/systemd/system/lookout-stream.service ] || fail "there is no lookout-stream.service"
echo '[stream]
socket = "/run/lookout-stream/socket"
group = "lookout-readers"' >>/etc/lookout/lookout.toml
systemctl start lookout-stream || fail "lookout-stream does not start"
wait_for 20 "no socket for readers" test -S /run/lookout-stream/socket
readers=$(stat -c '%a %U:%G' /run/lookout-stream/socket)
[ "$readers" = "660 lookout:lookout-readers" ] || fail "the socket is of $readers"
reader() { setpriv --reuid 65534 --regid 65534 "$@" lookout stream --socket /run/lookout-stream/socket --limit 1; }
reader --groups lookout-readers | grep -q '"alarm":{' || fail "a member of lookout-readers gets no results"
reader --clear-groups >/dev/null 2>&1 && fail "another user gets results"
say "results on a socket of $readers: for members of the group only"

systemctl start lookout-view || fail "lookout-view does not start"
page() { # PATH
  exec 3<>/dev/tcp/127.0.0.1/8467 || return 1
  printf 'GET %s HTTP/1.1\r\nHost: 127.0.0.1:8467\r\nConnection: close\r\n\r\n' "$1" >&3
  timeout 5 cat <&3
  exec 3>&-
}
serves() { page / 2>/dev/null | grep -q '<title>'; }
wait_for 20 "the viewer serves no page" serves
page / | head -n 1 | grep -q ' 200 ' || fail "the viewer answers $(page / | head -n 1)"
say "viewer: serves its page as $(stat -c %U /proc/"$(systemctl show lookout-view --property MainPID --value)")"

kill -STOP "$pid"
say "scheduler stopped by SIGSTOP: waiting for the watchdog"
restarted() { [ "$(show MainPID)" != "$pid" ] && [ "$(show ActiveState)" = active ] && [ "$(show MainPID)" != 0 ]; }
wait_for 60 "the watchdog did not restart it" restarted
wait_for 20 "it does not run after the watchdog" says ": running"
[ "$(show NRestarts)" -ge 1 ] || fail "no restart is counted"
say "watchdog: killed and restarted, NRestarts=$(show NRestarts), clocks $(clocks)"
[ "$(processes)" -eq 5 ] || fail "stages of the killed run are left: $(processes) processes"

kill -KILL "$(show MainPID)"
before=$(show NRestarts)
again() { [ "$(show NRestarts)" -gt "$before" ] && says ": running"; }
wait_for 60 "it was not restarted after SIGKILL" again
[ "$(clocks)" = 2400000-2400000 ] || fail "clocks were not set anew: $(clocks)"
say "SIGKILL: restarted, clocks $(clocks)"

[ "$(systemctl show lookout-stream --property NRestarts --value)" = 0 ] || fail "lookout-stream did not survive the restarts"
reader --groups lookout-readers | grep -q '"alarm":{' || fail "no results after the restarts"

echo 97000 >"$zone/temp"
wait_for 20 "no power-off was requested" test -s /opt/test/off
wait_for 20 "lookout-poweroff does not reach systemd" test -e /opt/test/asked
say "97 °C: $(cat /opt/test/off)"
[ "$(systemctl show lookout-view --property NRestarts --value)" = 0 ] || fail "lookout-view did not survive the restarts"
serves || fail "the viewer serves no page after the restarts"
systemctl stop lookout-view
systemctl stop lookout-stream
[ ! -e /run/lookout-stream ] || fail "the socket is left"
systemctl stop lookout
[ "$(show Result)" = success ] || fail "it did not end well: $(show Result)"
[ "$(clocks)" = 600000-2400000 ] || fail "clocks were not put back: $(clocks)"
say "stopped: Result=$(show Result), clocks $(clocks)"
systemctl start lookout 2>/dev/null && fail "it started hot"
logged 'the daemon starts below' || fail "a hot start is not explained"
systemctl stop lookout
say "hot start refused"

# The last word of a killed run: clocks are put back although nothing is started again.
echo 60000 >"$zone/temp"
mkdir -p /run/systemd/system/lookout.service.d
printf '[Service]\nRestart=no\n' >/run/systemd/system/lookout.service.d/once.conf
systemctl daemon-reload
systemctl reset-failed lookout || true
systemctl start lookout
kill -KILL "$(show MainPID)"
ended() { [ "$(show ActiveState)" = failed ]; }
wait_for 20 "it did not end" ended
[ "$(clocks)" = 600000-2400000 ] || fail "ExecStopPost did not put the clocks back: $(clocks)"
say "SIGKILL without restart: ExecStopPost put the clocks back, $(clocks)"
systemctl reset-failed lookout
systemctl stop lookout-poweroff.path

left() { find /dev/shm /tmp /run/lookout -mindepth 1 -name '*lookout*' 2>/dev/null || true; }
# What a killed run left in shared memory goes with the next; after a clean stop nothing is there.
rm /run/systemd/system/lookout.service.d/once.conf
systemctl daemon-reload
systemctl start lookout
wait_for 20 "it does not run" says ": running"
systemctl stop lookout
[ -z "$(left)" ] || fail "left behind: $(left)"
[ ! -e /run/lookout ] || fail "the runtime folder is left"
say "after the last stop: nothing in /dev/shm, /tmp, /run/lookout"

if [ -e /opt/test/lookout.deb ]; then
  rm -r /etc/systemd/system/lookout-asked.service
  rm -r /etc/systemd/system/lookout.service.d /etc/systemd/system/lookout-poweroff.service.d /run/systemd/system/lookout.service.d
  cp /run/lookout.toml /etc/lookout/lookout.toml
  apt-get purge -y lookout >/run/apt.log 2>&1 || { cat /run/apt.log; fail "the package does not go"; }
  apt-get clean
  find / -xdev \( -path /proc -o -path /sys -o -path /opt/test -o -path /run \) -prune -o -print | sort >/run/after
  # What any installation changes: caches and logs of the package manager, folders of systemd's own services.
  comm -13 /run/before /run/after | grep -vE '^/var/(cache|log|lib/(apt|dpkg|systemd))|^/etc/[a-z-]*-$|^/tmp|^/dev|^/old|^/var/tmp/systemd-private-[0-9a-f]*-systemd-' >/run/left || true
  [ ! -s /run/left ] || fail "left after purge: $(cat /run/left)"
  say "purged: nothing left; users: $(getent passwd lookout || echo none)"
fi
echo passed
