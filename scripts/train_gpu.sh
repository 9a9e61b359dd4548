#!/usr/bin/env bash
# Train a recipe at the paper's network size on one machine with a GPU and many cores, for a limited time.
#
#   scripts/train_gpu.sh TASK MINUTES OUT [--set SECTION.FIELD=VALUE ...]
#
# TASK is exploration, navigation or both. Learner on the GPU, grid actors and one evaluator on the cores, all over the
# bus; as many updates as the time should do. Whatever happens, OUT then holds the best and the last policy with their
# cards, the learning curve, the resolved configuration, the log and the list of episodes. A second call with the same
# OUT goes on where the first one ended. Needs the packages of `pip install .[learner,actor,plots]`; no PyBullet.
set -uo pipefail
if [ $# -lt 3 ]; then
    sed -n '2,9p' "$0" >&2
    exit 2
fi
task=$1 minutes=$2 out=$3
shift 3
cd "$(dirname "$0")/.."
mkdir -p "$out"
out=$(cd "$out" && pwd)
run=gpu-$task
python=${PYTHON:-$([ -x .venv/bin/python ] && echo .venv/bin/python || echo python3)}
cores=$(nproc)
actors=$((cores > 4 ? cores - 3 : 1))
learner() { "$python" -m learner "$@"; }

# What an NVIDIA H100 makes in this time (docs/training.md): learning rates fall to the end of it.
updates=$((375 * minutes))
sizes=(
    --set network.width=128 --set network.heads=8 --set network.layers=6
    --set learner.batch_size=256 --set learner.updates_per_step=0.05
    --set cloning.updates=$((updates / 5)) --set sac.critic_only_updates=200 --set learner.total_updates=$updates
    --set replay.capacity=200000 --set replay.max_bytes=4000000000
    --set checkpoints.every_seconds=120 --set checkpoints.keep=4
)
if [ -d "$out/runs/$run" ]; then
    command=(resume)
else
    command=(start --preset "$task" "${sizes[@]}" "$@")
fi
echo "training $task for $minutes minutes with $actors actors on $cores cores"
timeout --signal=INT --kill-after=60 "${minutes}m" \
    "$python" -m learner "${command[@]}" --run "$run" --runs "$out/runs" --sim grid --actors "$actors" --evaluators 1 \
    > "$out/$run.log" 2>&1
echo "training ended with code $? (124: the time was up)"
tail -n 3 "$out/$run.log"
for which in best last; do
    learner export --run "$run" --runs "$out/runs" --which "$which" --out "$out/$run-$which.safetensors"
done
learner plot --run "$run" --runs "$out/runs" --out "$out/$run.png"
cp "$out/runs/$run"/config.* "$out/" 2> /dev/null
gzip -c "$out/runs/$run/episodes.jsonl" > "$out/$run-episodes.jsonl.gz"
ls -l "$out"
