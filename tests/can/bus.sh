#!/usr/bin/env bash
# The vehicle's bus for real: frames on a virtual CAN bus of the kernel, and what `lookout status` says of them.
#
#   tests/can/bus.sh [BINARY] [DBC]        default: ./lookout and ./car.dbc
#
# Needs root, a kernel with the module vcan, ip, cangen (packages iproute2, can-utils), and a binary with the feature
# `can`. Runs anywhere, also in a slow emulated machine: nothing in it depends on how fast that is. Ends with "passed" and
# exit code 0; else what went wrong and the log of the daemon.
set -euo pipefail
binary=$(realpath "${1:-lookout}") dbc=$(realpath "${2:-car.dbc}")
bus=can7
work=$(mktemp -d)
cd "$work"
daemon= sender=
clean() {
  kill $sender $daemon 2>/dev/null || true
  wait 2>/dev/null || true
  ip link del $bus 2>/dev/null || true
  rm -rf "$work"
}
trap clean EXIT
fail() {
  echo "FAILED: $*"
  tail -n 60 log || true
  exit 1
}
# Waits until a command succeeds.
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    kill -0 $daemon || fail "$what: the daemon has ended"
    [ "$SECONDS" -lt "$until" ] || fail "$what: $("$binary" status -c car.toml --json | tr -d ' \n')"
    sleep 0.5
  done
}
# Whether the block `vehicle` of the status has a text.
says() {
  "$binary" status -c car.toml --json | tr -d ' \n' | grep -o '"vehicle":{[^}]*{[^}]*}' | grep -q -- "$1"
}
logged() { grep -q -- "$1" log; }
# Sends a frame twenty times a second, instead of the one before.
send() { # ID DATA
  if [ -n "$sender" ]; then
    # It may have ended with its interface.
    kill $sender 2>/dev/null || true
    wait $sender || true
  fi
  # cangen takes identifiers of more than three digits as extended with -e only.
  local extended=
  [ ${#1} -le 3 ] || extended=-e
  cangen $bus -g 50 $extended -I "$1" -L $((${#2} / 2)) -D "$2" &
  sender=$!
}

modprobe vcan
ip link add dev $bus type vcan
cat >car.toml <<TOML
[instance]
name = "can-test"
directory = "$work/run"
[stereo]
disparities = 32
[source]
fps = 0.5
[supervision]
startup_deadline_ms = 300000
liveness_deadline_ms = 300000
[alarm]
frame_age_max_ms = 0
[vehicle]
bus = "$bus"
dbc = "$dbc"
speed_signal = "Motion.Speed"
yaw_rate_signal = "Motion.YawRate"
brake_signal = "Levers.Brake"
turn_left_signal = "Levers.Turn=1,3"
turn_right_signal = "Levers.Turn=2,3"
gear_signal = "0x98FEF100:4|4@1+ (1,0)"
gear_reverse = "7"
stale_ms = 8000
TOML
"$binary" check-config car.toml >checked || fail "check-config"
sed 's/Motion.YawRate/Motion.Yaw/' car.toml >wrong.toml
"$binary" check-config wrong.toml >wrong 2>&1 && fail "a signal that does not exist is accepted"
grep -q 'vehicle.yaw_rate_signal = "Motion.Yaw": .*car.dbc: message Motion has no signal Yaw; it has Speed, YawRate' wrong ||
  fail "check-config: $(cat wrong)"

"$binary" run -c car.toml >log 2>&1 &
daemon=$!
wait_for 400 "no result with the fault of a bus that is down" says '"no_bus":true'
logged "the vehicle's bus cannot be read: .*$bus\|the vehicle's bus is open" || fail "the state of the bus is not told"
echo "the bus is down: told"

ip link set $bus up
# 35.6 km/h, 5 °/s to the left.
send 123 00E80D01F4000000
wait_for 400 "the speed of the bus is not in the status" says '"speed_m_s":9\.88'
says '"yaw_rate_rad_s":0\.0872' || fail "the yaw rate"
says '"missing":true' || fail "the signals that were never received are not told"
echo "speed and yaw rate: in the status"

# Brake, both indicators, reverse: the speed has no sign of its own.
send 18FEF100 7700
wait_for 400 "the levers" says '"braking":true,"turn_indicator":"both","gear":"reverse"'
wait_for 400 "the speed is not stale" says '"speed_m_s":null'
says '"stale":true' || fail "stale values are not told"
wait_for 60 "stale values are not logged" logged 'a value is stale'
echo "stale values: told, not used"

send 123 00FFFF01F4000000
wait_for 400 "an invalid value is not told" says '"out_of_range":true'
wait_for 400 "the yaw rate beside the invalid speed" says '"speed_m_s":null.*"yaw_rate_rad_s":0\.0872'
logged 'vehicle.speed_signal: the value 655.35 is out of range' || fail "the invalid value is not logged"
echo "a value out of range: told, not used"

ip link set $bus down
wait_for 400 "the bus that went down is not told" says '"no_bus":true'
wait_for 60 "the bus that went down is not logged" logged "the vehicle's bus cannot be read"
ip link set $bus up
send 123 00E80D01F4000000
wait_for 400 "the speed does not come back" says '"speed_m_s":9\.88'
echo "the bus went down and up: the speed is back"

allocations=$("$binary" status -c car.toml --json | tr -d ' \n' | grep -o '"role":"capture".*' | grep -o '"allocations":[0-9]*' | head -1)
echo "capture: $allocations"
kill -INT $daemon
wait $daemon || fail "it did not end well"
daemon=
echo passed
