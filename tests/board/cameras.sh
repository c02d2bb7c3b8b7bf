#!/usr/bin/env bash
# Cameras through the kernel: two devices of the driver vivid, every pixel format but MJPEG, several sizes, a stereo pair that
# is played into them and captured again, lost frames, devices that vanish and come back, and controls read back.
#
#   tests/board/cameras.sh BINARY FRAMES RECORDING.mcap
#
# FRAMES is what tests/board/frames.py made of the recording. Needs root, the module vivid and v4l2-ctl, best in a machine
# of its own: the module is loaded with options of its own. Nothing in it depends on how fast the machine is. Ends with
# "passed" and exit code 0; else what went wrong and the log of the daemon.
set -euo pipefail
[ $# -eq 3 ] || { sed -n '2,9s/^# \{0,1\}//p' "$0" >&2; exit 2; }
here=$(dirname "$(realpath "$0")")
binary=$(realpath "$1") frames=$(realpath "$2") recording=$(realpath "$3")
. "$here/kernel_cameras.sh"
work=$(mktemp -d)
cd "$work"
daemon=''
clean() {
  kill $daemon 2>/dev/null || true
  stop_playing
  wait 2>/dev/null || true
  rm -rf "$work"
}
trap clean EXIT
say() { echo "$*"; }
fail() {
  echo "FAILED: $*"
  tail -n 40 log || true
  dmesg | tail -n 5 || true
  exit 1
}
status() { "$binary" status -c car.toml --json 2>/dev/null | tr -d ' \n'; }
is() { status | grep -q -- "$1"; }
number() { status | grep -o "\"$1\":[0-9]*" | head -1 | cut -d: -f2; }
logged() { grep -q -- "$1" log; }
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    kill -0 $daemon 2>/dev/null || fail "$what: the daemon has ended"
    [ "$SECONDS" -lt "$until" ] || fail "$what: $(status | cut -c1-400)"
    sleep 0.5
  done
}
more_frames() { [ "$(number frames)" -ge $((${1:-0} + ${2:-3})) ]; }
# That of the built-in scenes.
cat >rig.toml <<TOML
focal_px = 879.0
baseline_m = 0.12
cx_px = 320.0
cy_px = 220.0
TOML
configure() { # LINES OF [camera]...
  cat >car.toml <<TOML
[instance]
name = "cameras"
directory = "$work/run"
[source]
kind = "camera"
rig = "rig.toml"
rectify = false
fps = 2.0
[stereo]
disparities = 64
[supervision]
startup_deadline_ms = 300000
liveness_deadline_ms = 300000
[alarm]
frame_age_max_ms = 0
[camera]
left = "$(node left cap)"
right = "$(node right cap)"
silence_ms = 5000
retry_first_ms = 500
retry_longest_ms = 2000
TOML
  printf '%s\n' "$@" >>car.toml
  "$binary" check-config car.toml >checked || { cat checked; fail "check-config"; }
}
start() {
  "$binary" run -c car.toml >log 2>&1 &
  daemon=$!
  wait_for 300 "no frames" more_frames 0 2
}
stop() {
  kill -INT $daemon
  wait $daemon || fail "the daemon did not end well"
  daemon=''
}
# The first disparity maps of a recording. The first captured frame may be older than the pair that is played.
maps_of() { # RECORDING NAME
  "$binary" replay "$1" --lockstep --limit 3 --set stereo.disparities=64 --set calibration.check=false \
    --set supervision.startup_deadline_ms=300000 --set instance.directory="$work/run" --out "$2" >replayed 2>&1 || { cat replayed; fail "the replay of $1"; }
  sha256sum "$2"/disparity/*.png | cut -d" " -f1
}

say "cameras: $("$binary" --version), Linux $(uname -r), $(uname -m)"
wanted=$(maps_of "$recording" wanted | sed -n 1p)

loop_cameras
"$binary" doctor >doctored || true
grep '/dev/video' doctored || fail "doctor lists no camera"
for format in ${FORMATS-GREY YUYV UYVY NV12 YU12}; do
  play $format "$frames/left.$format" "$frames/right.$format"
  sleep 3
  # Two free-running cameras: any phase is a pair of one picture that does not move.
  configure "format = \"$format\"" 'width = 640' 'height = 480' 'fps = 59.94' 'skew_ms = 8.3'
  start
  "$binary" record -c car.toml -o "$format.mcap" --raw --topics images --seconds 6 >recorded 2>&1 || { cat recorded; fail "record"; }
  ! logged exposure || fail "$format: a camera without exposure control is no fault"
  stop
  got=$(maps_of "$format.mcap" "got-$format")
  [[ $got == *"$wanted"* ]] || fail "$format: the map of what was captured is not that of what was played"
  say "$format: played, captured, matched: the map is that of the recording, byte for byte"
  rm -rf "$format.mcap" "got-$format"
done

pattern_cameras
# Frames that the driver loses.
for side in left right; do v4l2-ctl -d "$(node $side cap)" -c percentage_of_dropped_buffers=30; done
configure 'width = 320' 'height = 180' 'fps = 5' 'skew_ms = 99'
start
wait_for 120 "no pairs while frames are lost" more_frames "$(number frames)" 10
is '"state":"running"' || fail "with lost frames: $(status | cut -c1-300)"
say "30 % of the frames of each camera lost: $(number frames) pairs, running"
stop
for side in left right; do v4l2-ctl -d "$(node $side cap)" -c percentage_of_dropped_buffers=0; done
for size in 320x180 640x360 1280x720; do
  configure "width = ${size%x*}" "height = ${size#*x}" 'fps = 5' 'skew_ms = 99'
  start
  stop
  say "$size: frames"
done
configure 'width = 641' 'height = 480' 'fps = 5' 'skew_ms = 99'
"$binary" run -c car.toml >log 2>&1 &
daemon=$!
wait_for 120 "a size that the camera does not have is not told" logged 'not 641x480.*camera.width and camera.height'
stop
say "a size that it does not have: $(grep -o 'delivers [^:]*' log | head -1)"

# Controls: the driver has a gain, and no exposure time.
configure 'width = 320' 'height = 180' 'fps = 5' 'skew_ms = 99' 'exposure = "fixed"' 'exposure_us = 5000' 'gain = 77'
start
for side in left right; do
  controls=$(v4l2-ctl -d "$(node $side cap)" -C gain,gain_automatic | tr '\n' ' ')
  [ "$controls" = "gain: 77 gain_automatic: 0 " ] || fail "$side: $controls"
done
logged 'cannot set camera.exposure_us' || fail "a control that the camera does not have is not told"
say "controls: gain 77 and no automatic gain, read back from both; the missing exposure time is told"

# A camera that is pulled and comes back, under its name: the driver gives it back when it is closed.
left=$(node left cap)
before=$(number frames)
v4l2-ctl -d "$left" -c disconnect=1 >/dev/null 2>&1 || true
wait_for 60 "the loss is not told" logged "$left.*No such device"
wait_for 120 "no frames after the camera came back" more_frames "$(number frames)"
say "the left camera was disconnected: told, and pairs again ($before, then $(number frames))"
for again in 1 2; do
  before=$(number frames) nodes="$(node left cap) $(node right cap)"
  echo vivid.0 >/sys/bus/platform/drivers/vivid/unbind
  wait_for 60 "the unbound devices are not told" is '"state":"degraded"'
  reason=$(status | grep -o '"reason":"[^"]*"' | head -1)
  echo vivid.0 >/sys/bus/platform/drivers/vivid/bind
  udevadm settle
  [ "$(node left cap) $(node right cap)" = "$nodes" ] || fail "the cameras have other names now: $nodes, then $(node left cap) $(node right cap)"
  wait_for 120 "no frames after the devices were bound again" more_frames "$(number frames)"
  wait_for 60 "it stays degraded" is '"state":"running"'
  say "unbound and bound again ($again): $reason; pairs again under the same names ($before, then $(number frames))"
done
pid=$(status | grep -o '{"role":"capture"[^}]*' | grep -o '"pid":[0-9]*' | cut -d: -f2)
open=$(find "/proc/$pid/fd" -lname '/dev/video*' | wc -l)
[ "$open" -eq 2 ] || fail "capture has $open devices open"
[ "$(number restarts)" -eq 0 ] || fail "a stage was restarted for a camera"
stop
modprobe -r vivid
say "the driver could be unloaded"
echo passed
