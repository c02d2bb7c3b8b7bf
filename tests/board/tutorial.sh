#!/usr/bin/env bash
# docs/tutorial.md followed on a board with two cameras of the kernel: from the package to the service.
#
#   tests/board/tutorial.sh PACKAGE.deb FRAMES BOARDS
#
# FRAMES is what tests/board/frames.py made of a recording of a built-in scene, BOARDS what the example render_boards wrote
# (cargo run --release -p lookout-sources --example render_boards -- BOARDS): both are played into the cameras. Runs on a board
# or in an emulated machine, as root, with the module vivid and v4l2-ctl, where no lookout is installed. Each command is looked
# up in the tutorial that the package brings, so that the two cannot part. What the tutorial leaves to people (screws,
# printing, a phone, driving) and jq is left out. Ends with "passed" and exit code 0.
set -euo pipefail
[ $# -eq 3 ] || { sed -n '2,11s/^# \{0,1\}//p' "$0" >&2; exit 2; }
here=$(dirname "$(realpath "$0")")
package=$(realpath "$1") frames=$(realpath "$2") boards=$(realpath "$3")
. "$here/kernel_cameras.sh"
work=$(mktemp -d)
cd "$work"
pids=''
clean() {
  kill $pids 2>/dev/null || true
  stop_playing
  rm -rf "$work"
}
trap clean EXIT
say() { echo "== $*"; }
fail() {
  echo "FAILED: $*"
  tail -n 20 ./*.log car/*.log 2>/dev/null || true
  journalctl -u lookout --no-pager -o cat -n 20 2>/dev/null || true
  exit 1
}
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    [ "$SECONDS" -lt "$until" ] || fail "$what"
    sleep 0.5
  done
}
# A minimal system has no sudo; this script runs as root.
if ! command -v sudo >/dev/null; then
  mkdir bin
  cat >bin/sudo <<'SH'
#!/bin/sh
if [ "$1" = -u ]; then user=$2; shift 2; exec setpriv --reuid "$user" --regid "$user" --init-groups "$@"; fi
exec "$@"
SH
  chmod +x bin/sudo
  PATH=$work/bin:$PATH
fi
# Runs a line of the tutorial, with the names of the cameras here. An expected exit code may stand before it.
tutorial=''
step() { # [CODE] LINE
  local wanted=0
  if [[ $1 =~ ^[0-9]+$ ]]; then wanted=$1 && shift; fi
  if [ -n "$tutorial" ]; then grep -qF -- "$1" "$tutorial" || fail "not in the tutorial: $1"; fi
  local line=${1//\/dev\/v4l\/by-path\/LEFT/$left} code=0
  line=${line//\/dev\/v4l\/by-path\/RIGHT/$right}
  say "$line"
  eval "${LIMIT:-} $line" || code=$?
  [ "$code" = "$wanted" ] || fail "$line: exit code $code"
}
loop_cameras
left=$(node left cap) right=$(node right cap)

# 2. Install
mkdir -p target/package && cp "$package" target/package/
# shellcheck disable=SC2016
step 'sudo apt install ./target/package/lookout_*_"$(dpkg --print-architecture)".deb' >install.log 2>&1
zcat /usr/share/doc/lookout/tutorial.md.gz >tutorial.md
tutorial=$work/tutorial.md
cat install.log | tail -n 3
step 'lookout doctor'

# 4. Write a configuration
step 'mkdir car && cd car'
step 'lookout init --left /dev/v4l/by-path/LEFT --right /dev/v4l/by-path/RIGHT --size 640x480 --fps 30 --board rpi5 -o car.toml'
step 'lookout check-config car.toml' >check.log
step 'lookout doctor -c car.toml' | grep -E 'camera|problem' || true
# Two cameras without a common trigger; and times for a machine that is much slower than a board.
sed -i -e 's/^# skew_ms = .*/skew_ms = 16.0/' -e 's/^# width_m = .*/width_m = 1.9/' -e 's/^# front_m = .*/front_m = 1.5/' car.toml
grep -q '^skew_ms = 16.0' car.toml || fail "init does not show camera.skew_ms"
cat >>car.toml <<'TOML'
silence_ms = 20000
[supervision]
startup_deadline_ms = 300000
liveness_deadline_ms = 300000
[realtime]
budget_ms = 60000
TOML

# 6. Calibrate, with boards that are held for as long as it takes to keep them.
[ "$(grep -c -- 'lookout calibrate --live camera -c car.toml --board 9x6 --square-mm 25 -o rig.toml --report calibration' "$tutorial")" = 1 ] || fail "calibrate"
say 'lookout calibrate --live camera -c car.toml --board 9x6 --square-mm 25 -o rig.toml --report calibration'
lookout calibrate --live camera -c car.toml --board 9x6 --square-mm 25 -o rig.toml --report calibration >calibrate.out 2>calibrate.log &
calibration=$!
pids=$calibration
for board in "$boards"/left-*.GREY; do
  kept=$(grep -c ' kept' calibrate.log || true)
  play GREY "$board" "${board/left-/right-}"
  until=$((SECONDS + 60))
  while [ "$SECONDS" -lt $until ] && kill -0 $calibration 2>/dev/null; do
    [ "$(grep -c ' kept' calibrate.log || true)" = "$kept" ] || break
    sleep 0.5
  done
  kill -0 $calibration 2>/dev/null || break
done
stop_playing
kill -INT $calibration 2>/dev/null || true
wait $calibration || fail "the calibration"
pids=''
grep -v 'not detected' calibrate.log | tail -n 8
cat calibrate.out
[ -s rig.toml ] && [ -s calibration/index.html ] || fail "no rig.toml, or no report"
# shellcheck disable=SC2016
sed -i 's/^# rig = .*/rig = "rig.toml"/' car.toml
step 'lookout check-config car.toml' >check.log
grep '^rig' check.log

# 7. Run, before a street
play GREY "$frames/left.GREY" "$frames/right.GREY"
sleep 2
say 'lookout run -c car.toml'
grep -qF 'lookout run -c car.toml' "$tutorial" || fail "run"
lookout run -c car.toml >run.log 2>&1 &
daemon=$!
pids=$daemon
status() { lookout status --json 2>/dev/null | tr -d ' \n'; }
has_frames() { [ "$(status | grep -o '"frames":[0-9]*' | head -1 | cut -d: -f2)" -ge "${1:-3}" ]; }
wait_for 300 "no frames" has_frames 3
LIMIT='timeout -s INT 15' step 124 'lookout status --watch' >watch.log
lookout status
# The viewer's page, without a browser.
say 'lookout view'
lookout view >view.log 2>&1 &
viewer=$!
pids="$daemon $viewer"
page() { exec 3<>/dev/tcp/127.0.0.1/8467 && printf 'GET / HTTP/1.1\r\nHost: 127.0.0.1:8467\r\nConnection: close\r\n\r\n' >&3 && head -c 15 <&3 | grep '200'; }
wait_for 60 "no page" page
say "http://127.0.0.1:8467: $(page)"

# 8. An alarm
grep -qF "lookout stream | jq -r '[.alarm.level, .alarm.reason] | @tsv'" "$tutorial" || fail "stream"
lookout stream --limit 1 | grep -o '"alarm":{[^}]*}'

# 9. Drive, and look at it afterwards
LIMIT='timeout -s INT 20' step 124 'lookout record -o drive.mcap --split-mb 2000'
kill -INT $viewer $daemon
wait $viewer $daemon || fail "run or view did not end well"
pids=''
step 'lookout evaluate drive drive_0001.mcap --out report'
step 'lookout replay drive_0001.mcap --lockstep --set alarm.distance_m=6 --out again' | tail -n 6

# 10. Install it as a service
step 'sudo install -m 644 car.toml /etc/lookout/lookout.toml'
step 'sudo install -m 644 rig.toml /etc/lookout/'
step 'lookout check-config /etc/lookout/lookout.toml' >check.log
step 'sudo -u lookout lookout doctor -c /etc/lookout/lookout.toml'
mkdir -p /etc/systemd/system/lookout.service.d
printf '[Service]\nTimeoutStartSec=600\n' >/etc/systemd/system/lookout.service.d/slow.conf
systemctl daemon-reload
step 'sudo systemctl enable --now lookout'
service_has_frames() { sudo -u lookout lookout status | grep -E ': (running|degraded).* [1-9][0-9]* frames'; }
wait_for 300 "the service has no frames" service_has_frames
step 'sudo -u lookout lookout status'
step 'sudo systemctl enable --now lookout-view'
wait_for 60 "the service's page does not come" page
say "http://127.0.0.1:8467: $(page)"
sudo systemctl disable --now lookout-view lookout
stop_playing
echo passed
