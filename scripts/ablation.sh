#!/usr/bin/env bash
# Train the paper's three variants with the same small budget, and evaluate them on maps that none of them saw.
#
#   scripts/ablation.sh OUT [SEEDS [UPDATES]]
#
# OUT/<variant>-<seed>/ then holds a run's results for `hd-eval table`; default: seeds "0 1" and 1,600 updates, half of them
# imitation and half soft actor-critic. A run is one process of one thread, learner and actor together, and takes about
# eight minutes of a core. Called again it goes on with what is not done. TRAIN, VALIDATION and LIMIT choose the
# worlds; the defaults need no download.
set -euo pipefail
if [ $# -lt 1 ]; then
    sed -n '2,9p' "$0" >&2
    exit 2
fi
mkdir -p "$1"
out=$(cd "$1" && pwd)
seeds=${2:-0 1}
updates=${3:-1600}
train=${TRAIN:-generator:rooms}
validation=${VALIDATION:-generator:rooms?seed=1000000}
limit=${LIMIT:-100}
cd "$(dirname "$0")/.."
python=${PYTHON:-$([ -x .venv/bin/python ] && echo .venv/bin/python || echo python3)}
learner() { "$python" -m learner "$@"; }
evaluate() { "$python" -m actors.evaluation run --maps "$validation" --limit "$limit" --jobs 1 "$@"; }

for seed in $seeds; do
    for variant in vanilla hierarchical hdplanner; do
        run=$variant-$seed
        [ -e "$out/$run/hdplanner.json" ] && continue
        if [ -d "$out/runs/$run" ]; then
            learner resume --serial --runs "$out/runs" --run "$run"
        else
            learner start --preset exploration --serial --runs "$out/runs" --run "$run" \
                --set "maps.train=$train" --set "seed=$seed" --set "network.variant=$variant" \
                --set "cloning.updates=$((updates / 2))" --set "learner.total_updates=$updates" \
                --set sac.critic_only_updates=100 --set learner.threads=1
        fi
        learner export --runs "$out/runs" --run "$run" --which last --out "$out/$run.safetensors"
        evaluate --planner hdplanner --policy "$out/$run.safetensors" --out "$out/$run"
    done
done
evaluate --planner greedy --out "$out/greedy"
