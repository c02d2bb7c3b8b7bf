#!/usr/bin/env bash
# Results of replays that have to be the same on every machine, byte for byte.
#
#   tests/board/replays.sh BINARY OUT [RECORDING ...]
#
# Runs each recording and some synthetic drives in lock-step and writes OUT/sums: a line for each obstacles.jsonl and for
# all disparity maps of a run. Run it on two machines and compare the two files; where a line differs, `lookout compare`
# of the two folders OUT/NAME names the frames. FRAMES=N sets the pairs of each run (16). Needs sha256sum.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,8s/^# \{0,1\}//p' "$0" >&2; exit 2; }
binary=$(realpath "$1") out=$2 frames=${FRAMES:-16}
shift 2
recordings=()
for recording in "$@"; do recordings+=("$(realpath "$recording")"); done
mkdir -p "$out"
cd "$out"
# Paths of sockets are short.
run=$(mktemp -d)
trap 'rm -rf "$run"' EXIT
: >sums
# Nothing may depend on how fast the machine is.
cat >replays.toml <<TOML
[instance]
name = "replays"
directory = "$run"
[supervision]
startup_deadline_ms = 300000
liveness_deadline_ms = 300000
TOML
replay() { # NAME ARGUMENTS...
  local name=$1
  shift
  "$binary" replay -c replays.toml --lockstep --limit "$frames" --out "$name" "$@" >"$name.log" 2>&1 ||
    { tail -n 20 "$name.log"; echo "FAILED: $name"; exit 1; }
  sha256sum "$name/obstacles.jsonl" >>sums
  (cd "$name/disparity" && cat -- *.png | sha256sum | sed "s|-\$|$name/disparity|") >>sums
  echo "$name: $(wc -l <"$name/obstacles.jsonl") frames"
}
replay street scene:street
replay full scene:street --set stereo.method=full
replay night 'scene:street?weather=night&seed=7'
replay bend scene:bend
replay debris scene:debris
i=0
for recording in "${recordings[@]}"; do
  i=$((i + 1))
  replay "recording$i" "$recording"
done
