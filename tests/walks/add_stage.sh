#!/usr/bin/env bash
# The walk "add a stage" of CONTRIBUTING.md: a stage `lanes` that reads `depth` and does nothing is added to a copy of
# the tree. It must compile, and take at most three existing files. `--run` also builds the copy (debug) and shows
# that the stage runs and takes part in lock-step.
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$PWD
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
git ls-files -z -- . ':(exclude)docs/pictures' | xargs -0 cp --parents -t "$copy"
cd "$copy"
git init -q . && git add -A && git -c user.name=walk -c user.email=walk@example.org commit -qm before

# 1: the service and the stage.
sed -i '/^    STATUS = Status(/a\    /// Lanes of the road: lanes → readers.\n    LANES = Lanes(8) { name: "lanes", subscribers: 1 + READERS, }' ipc/src/pipeline.rs
line=$(grep -n '^/// The service whose messages are the' ipc/src/pipeline.rs | cut -d: -f1)
sed -i "$((line - 2))i\\    /// Depth to lanes.\n    Lanes = 6 {\n        name: \"lanes\",\n        input: Some(\&DEPTH),\n        output: Some(\&LANES),\n        core: Core::With(Role::Road),\n    }" ipc/src/pipeline.rs
# 2: the message.
sed -i '/^    status::StatusMessage,/a\    lanes::LanesMessage,' ipc/src/message/mod.rs
# 3: the constructor.
sed -i 's/^pub mod capture;/pub mod capture;\npub mod lanes;/; /^        Role::Capture => /a\        Role::Lanes => frames::<lanes::LanesStage>(),' daemon/src/stages/mod.rs
# New files.
cp "$root/tests/walks/lanes/message.rs" ipc/src/message/lanes.rs
mkdir -p daemon/src/stages/lanes && cp "$root/tests/walks/lanes/stage.rs" daemon/src/stages/lanes/mod.rs

git diff --stat
touched=$(git diff --name-only | wc -l)
# Beside the lints' and the documentation's results, with the features they had: what the crates that are not ours are checked for
# stays the same.
export CARGO_TARGET_DIR=${WALK_TARGET_DIR:-$root/target}
if [ "${1:-}" = --run ]; then
  cargo run --locked -- replay scene:drive --lockstep --limit 6 --set stereo.disparities=32 --json > summary.json
  grep -A3 '"role": "lanes"' summary.json
  grep -q '"frames": 6' summary.json
else
  cargo check --quiet --release --locked --workspace --features "${WALK_FEATURES:-}"
fi
echo "a stage that does nothing: $touched existing files touched"
[ "$touched" -le 3 ]
