#!/usr/bin/env bash
# CAN out for real: the frames of `lookout can` on a virtual CAN bus of the kernel, compared with the results of the run,
# and what `lookout status` says while the bus is down, does not take frames, or has another sender.
#
#   tests/can/out.sh [BINARY] [DBC] [PYTHON]     default: ./lookout, ./lookout.dbc, python3
#
# Needs root, a kernel with the module vcan (and sch_netem for a slow bus), ip, tc, candump, cansend (packages iproute2,
# can-utils), a Python with cantools (else the values are not compared), and a binary with the feature `can`. check_out.py
# has to be beside this script. KEEP=FOLDER keeps frames.log and obstacles.jsonl there, to be compared elsewhere. Nothing in
# it depends on how fast the machine is. Ends with "passed" and exit code 0; else what went wrong and the logs.
set -euo pipefail
binary=$(realpath "${1:-lookout}") dbc=$(realpath "${2:-lookout.dbc}") python=${3:-python3}
check=$(dirname "$(realpath "$0")")/check_out.py
bus=can8
work=$(mktemp -d)
cd "$work"
daemon='' sender='' dump=''
clean() {
  kill $dump $sender $daemon 2>/dev/null || true
  wait 2>/dev/null || true
  ip link del $bus 2>/dev/null || true
  rm -rf "$work"
}
trap clean EXIT
fail() {
  echo "FAILED: $*"
  tail -n 30 log || true
  tail -n 30 can.log || true
  exit 1
}
# Waits until a command succeeds.
wait_for() { # SECONDS WHAT COMMAND...
  local until=$((SECONDS + $1)) what=$2
  shift 2
  until "$@" >/dev/null 2>&1; do
    kill -0 $sender || fail "$what: lookout can has ended"
    [ "$SECONDS" -lt "$until" ] || fail "$what: $("$binary" status -c car.toml --json | tr -d ' \n' | grep -o '"can_out".*')"
    sleep 0.5
  done
}
# Whether the block `can_out` of the status has a text.
says() { "$binary" status -c car.toml --json | tr -d ' \n' | grep -o '"can_out":{.*' | grep -q -- "$1"; }
logged() { grep -q -- "$1" can.log; }
# Data of the next status frame.
status_frame() { candump -n 1 -T 5000 -L "$bus,640:7FF" | sed 's/.*#//'; }
# Whether the daemon's state in the status frames has a number.
daemon_is() {
  local data
  data=$(status_frame)
  # Bits 18 to 20: byte 2.
  [ $((0x${data:4:2} >> 2 & 7)) -eq "$1" ]
}
count() { "$binary" status -c car.toml --json | tr -d ' \n' | grep -o "\"$1\":[0-9]*" | head -1 | cut -d: -f2; }

modprobe vcan echo=1 2>/dev/null || true
ip link add dev $bus type vcan
cat >car.toml <<TOML
[instance]
name = "out-test"
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
[can_out]
interface = "$bus"
period_ms = 50
stale_ms = 60000
TOML
"$binary" check-config car.toml >checked || fail "check-config"
"$binary" can -c car.toml --dbc | cmp - "$dbc" || fail "the DBC file is not that of the binary"

"$binary" can -c car.toml >can.log 2>&1 &
sender=$!
wait_for 60 "an interface that is down is not told" logged 'the interface cannot be used'
ip link set $bus up
wait_for 60 "no frames without a daemon" daemon_is 4
echo "without a daemon: the frames say so"

candump -L $bus >frames.log &
dump=$!
"$binary" replay -c car.toml --set source.fps=0 scene:street --lockstep --limit 24 --out results >log 2>&1 || fail "the replay"
wait_for 60 "the end of the daemon is not told on the bus" daemon_is 4
sleep 1
kill $dump
wait $dump || true
dump=
if [ -n "${KEEP:-}" ]; then
  mkdir -p "$KEEP"
  cp frames.log results/obstacles.jsonl "$KEEP"
fi
if "$python" -c 'import cantools' 2>/dev/null; then
  "$python" "$check" frames.log results/obstacles.jsonl "$dbc" || fail "the frames differ from obstacles.jsonl"
else
  echo "skipped: $python has no cantools, so the values were not compared"
fi

"$binary" run -c car.toml >log 2>&1 &
daemon=$!
wait_for 400 "the daemon is not told on the bus" daemon_is 1
wait_for 60 "the status does not tell the bus" says '"state":"sending"'
"$binary" can -c car.toml >second 2>&1 && fail "a second sender is not refused"
grep -q 'another lookout can' second || fail "a second sender: $(cat second)"
frames=$(count frames)

ip link set $bus down
wait_for 60 "a bus that went down is not told" says '"state":"down"'
ip link set $bus up
wait_for 60 "the bus does not come back" says '"state":"sending"'
echo "the bus went down and up: told, and frames again"

if tc qdisc add dev $bus root netem rate 1kbit limit 5 2>/dev/null; then
  wait_for 60 "a bus that takes no frames is not told" says '"state":"\(full\|unacknowledged\)"'
  tc qdisc del dev $bus root
  wait_for 60 "the bus does not recover" says '"state":"sending"'
  echo "a bus that was too slow: told, and frames again"
else
  echo "skipped: no sch_netem, so no slow bus"
fi

# The identifier of the last frame of a cycle.
cansend $bus 657#0102030405060708
wait_for 60 "another sender is not told" says '"state":"conflict"'
wait_for 60 "the conflict does not end" says '"state":"sending"'
echo "another sender of our identifiers: told"

ip link del $bus
wait_for 60 "an interface that is gone is not told" says '"state":"down"'
ip link add dev $bus type vcan
ip link set $bus up
wait_for 60 "the new interface is not used" says '"state":"sending"'
echo "the interface was removed and came back: told, and frames again"
more=$(count frames)
[ "$more" -gt "$frames" ] || fail "the daemon made no frames meanwhile: $frames, then $more"
[ "$(count restarts)" -eq 0 ] || fail "a stage was restarted"

kill -KILL $daemon
wait $daemon 2>/dev/null || true
wait_for 60 "a killed daemon is not told" daemon_is 4
"$binary" run -c car.toml >log 2>&1 &
daemon=$!
wait_for 400 "the next daemon is not followed" daemon_is 1
echo "the daemon was killed and started anew: told, and followed"

"$binary" status -c car.toml | grep 'CAN out' || fail "the table of the status"
kill -INT $sender
wait $sender || fail "lookout can did not end well"
kill -INT $daemon
wait $daemon || fail "the daemon did not end well"
sender='' daemon=''
[ -z "$(ls run 2>/dev/null)" ] || fail "left behind: $(find run)"
echo passed
