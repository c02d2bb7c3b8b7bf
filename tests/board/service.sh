#!/usr/bin/env bash
# The package as a service on a board, real or emulated: installed, READY, cores, priorities, locked memory, killed stages,
# watchdog, reload, stop, purge without a trace, and the results of replays.
#
#   tests/board/service.sh PACKAGE.deb [SUMS [RECORDING ...]]
#
# Runs on the board, as root, on a Debian with systemd that has no lookout yet: everything of it is removed at the end. SUMS
# is what tests/board/replays.sh wrote on another machine for the same recordings: the results have to be the same, byte for
# byte. Nothing in it depends on how fast the machine is; four cores show that each process has its own. Ends with
# "passed" and exit code 0; else what went wrong and the log of the service.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '2,10s/^# \{0,1\}//p' "$0" >&2; exit 2; }
here=$(dirname "$(realpath "$0")")
package=$(realpath "$1") sums=${2:+$(realpath "$2")}
shift $(($# < 2 ? $# : 2))
recordings=()
for recording in "$@"; do recordings+=("$(realpath "$recording")"); done
[ "$(id -u)" -eq 0 ] || { echo "service.sh: run me as root" >&2; exit 2; }
[ ! -e /usr/bin/lookout ] && [ ! -e /etc/lookout ] || { echo "service.sh: lookout is installed here already" >&2; exit 2; }

say() { echo "$*"; }
fail() {
  echo "FAILED: $*"
  systemctl status lookout --no-pager -l || true
  journalctl -u lookout --no-pager -o short-monotonic -n 60 || true
  exit 1
}
logged() { journalctl -u lookout --no-pager -o cat | grep -q -- "$1"; }
show() { systemctl show lookout --property "$1" --value; }
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    [ "$SECONDS" -lt "$until" ] || fail "$what"
    sleep 0.5
  done
}
as_user() { setpriv --reuid lookout --regid lookout --init-groups "$@"; }
status() { as_user lookout status --json 2>/dev/null | tr -d ' \n'; }
is() { status | grep -q -- "$1"; }
number() { status | grep -o "\"$1\":[0-9]*" | head -1 | cut -d: -f2; }
# A line for each process: role, process, core, restarts, priority, whether its memory is locked.
processes() {
  status | grep -o '{"role":"[^}]*}' | sed -E 's/.*"role":"([a-z]+)".*"pid":([0-9]+),"core":([0-9]+),"restarts":([0-9]+).*"priority":([0-9]+),"memory_locked":(true|false).*/\1 \2 \3 \4 \5 \6/'
}
of() { processes | awk -v role="$1" -v column="$2" '$1 == role { print $column }'; } # ROLE COLUMN
files() {
  find / -xdev \( -path /proc -o -path /sys -o -path /run -o -path /tmp -o -path "$here" -o -path /var/log -o -path /var/cache -o -path /var/lib/apt \
    -o -path /var/lib/dpkg -o -path /var/lib/systemd -o -path /var/tmp \) -prune -o -print | grep -vE '^/etc/[a-z-]*-$' | sort
}

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
files >"$work/before"
apt-get install -y --no-install-recommends "$package" >"$work/apt.log" 2>&1 || { cat "$work/apt.log"; fail "the package does not install"; }
say "installed: $(dpkg-query -W lookout) on $(uname -m), $(nproc) cores, Linux $(uname -r)"
lookout --version
! systemctl is-enabled --quiet lookout || fail "it is enabled before it was configured"

# Slow machines: time to start. Everything else of the unit as it is shipped.
mkdir -p /etc/systemd/system/lookout.service.d
printf '[Service]\nTimeoutStartSec=600\n' >/etc/systemd/system/lookout.service.d/slow.conf
systemctl daemon-reload
cat >/etc/lookout/lookout.toml <<TOML
profile = "rpi5"
[source]
fps = 0.5
[stereo]
disparities = 32
[realtime]
scheduling = "require"
memory_lock = "require"
prefault = "require"
pinning = "require"
budget_ms = 60000
[heat]
watch = "off"
[clocks]
set = "off"
[pacing]
follow = false
deadline_ms = 0
[supervision]
startup_deadline_ms = 120000
liveness_deadline_ms = 60000
[alarm]
frame_age_max_ms = 0
TOML
lookout check-config /etc/lookout/lookout.toml >/dev/null || fail "check-config"
systemctl start lookout || fail "it does not start"
[ "$(show ActiveState)" = active ] || fail "not active"
say "READY: $(show StatusText)"
wait_for 120 "it does not run" is '"state":"running"'
as_user lookout status

# What was configured against what the kernel says.
[ "$(processes | wc -l)" -eq 5 ] || fail "processes: $(processes)"
for wanted in scheduler:0:55 capture:0:50 stereo:3:20 road:2:30 recognition:1:40; do
  IFS=: read -r role core priority <<<"$wanted"
  core=$((core % $(nproc))) pid=$(of "$role" 2)
  allowed=$(sed -n 's/^Cpus_allowed_list:\s*//p' "/proc/$pid/status")
  [ "$allowed" = "$core" ] || fail "$role may run on $allowed, not on $core alone"
  chrt -p "$pid" | tr '\n' ' ' | grep -q "SCHED_FIFO.* priority: $priority " || fail "$role: $(chrt -p "$pid")"
  locked=$(sed -n 's/^VmLck:\s*\([0-9]*\) kB/\1/p' "/proc/$pid/status")
  [ "$locked" -gt 0 ] && [ "$(of "$role" 6)" = true ] || fail "$role has $locked kB of locked memory"
  [ "$(stat -c %U "/proc/$pid")" = lookout ] || fail "$role runs as $(stat -c %U "/proc/$pid")"
  say "$role: core $allowed, SCHED_FIFO $priority, $locked kB locked, user lookout"
done

for role in capture stereo road recognition; do
  pid=$(of "$role" 2) frames=$(number frames)
  kill -KILL "$pid"
  back() { [ "$(of "$role" 4)" -ge 1 ] && [ "$(of "$role" 2)" != "$pid" ] && is '"state":"running"' && [ "$(number frames)" -gt "$frames" ]; }
  wait_for 240 "$role does not come back" back
  say "$role killed: restarted, frames go on ($frames, then $(number frames))"
done
[ "$(show NRestarts)" = 0 ] || fail "the service was restarted for a stage"

pid=$(show MainPID)
echo 'distance_m = 12' >>/etc/lookout/lookout.toml
systemctl reload lookout
wait_for 120 "the reload was not told" logged 'changed: alarm.distance_m'
wait_for 240 "it does not run after the reload" is '"state":"running"'
[ "$(show MainPID)" = "$pid" ] || fail "the reload restarted it"
say "reloaded: alarm.distance_m, the same process"

kill -STOP "$pid"
restarted() { [ "$(show MainPID)" != "$pid" ] && [ "$(show ActiveState)" = active ] && [ "$(show MainPID)" != 0 ]; }
wait_for 300 "the watchdog did not restart it" restarted
wait_for 240 "it does not run after the watchdog" is '"state":"running"'
[ "$(show NRestarts)" -ge 1 ] || fail "no restart is counted"
[ "$(readlink /proc/[0-9]*/exe | grep -c '^/usr/bin/lookout')" -eq 5 ] || fail "processes of the killed run are left"
say "watchdog: a stopped scheduler was killed and restarted after $(show WatchdogUSec), NRestarts=$(show NRestarts)"

systemctl stop lookout
[ "$(show Result)" = success ] || fail "it did not end well: $(show Result)"
left=$(find /dev/shm /tmp /run -xdev -name '*lookout*' ! -path '/run/systemd/*' ! -path "$work*" 2>/dev/null || true)
[ -z "$left" ] || fail "left behind: $left"
say "stopped: Result=$(show Result), nothing in /dev/shm, /tmp, /run"

if [ -n "$sums" ]; then
  "$here/replays.sh" /usr/bin/lookout "$work/replays" ${recordings[@]+"${recordings[@]}"}
  if diff "$sums" "$work/replays/sums"; then
    say "replays: $(wc -l <"$sums") results are those of the other machine, byte for byte"
  else
    differs=1
  fi
fi

rm -r /etc/systemd/system/lookout.service.d
apt-get purge -y lookout >"$work/apt.log" 2>&1 || { cat "$work/apt.log"; fail "the package does not go"; }
systemctl daemon-reload
files >"$work/after"
comm -13 "$work/before" "$work/after" >"$work/left"
[ ! -s "$work/left" ] || fail "left after the purge: $(cat "$work/left")"
for name in passwd:lookout group:lookout group:lookout-readers; do
  ! getent "${name%:*}" "${name#*:}" || fail "left after the purge: $name"
done
say "purged: no file, user or group left"
[ -z "${differs:-}" ] || { echo "FAILED: the results of the replays differ"; exit 1; }
echo passed
