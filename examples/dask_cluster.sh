#!/bin/sh
# Start a Dask scheduler and workers for `steelyard fleet --cluster tcp://HOST:8786`.
#
# usage: sh examples/dask_cluster.sh [WORKERS] [SCHEDULER]
#   WORKERS    worker processes on this machine, one thread each (default: all cores)
#   SCHEDULER  address of a scheduler elsewhere, tcp://HOST:8786: then only workers are started
#
# Versions are those of constraints.txt. Ctrl-C ends all of it; nothing that is done is lost.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
workers=${1:-$(getconf _NPROCESSORS_ONLN)}
scheduler=${2:-}
place=${STEELYARD_CLUSTER:-$HOME/.steelyard-cluster}
if [ ! -x "$place/bin/dask" ]; then
    python3 -m venv "$place"
    "$place/bin/pip" install -q -c "$root/constraints.txt" -e "$root[cluster,polars]"
fi
export OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 POLARS_MAX_THREADS=1
# Dask's own thresholds of memory make arrays of some size slow: logs would take twice the time
export DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED=False
export DASK_DISTRIBUTED__NANNY__PRE_SPAWN_ENVIRON='{"MALLOC_TRIM_THRESHOLD_": 1073741824, "MALLOC_MMAP_THRESHOLD_": 33554432}'
trap 'kill 0' INT TERM EXIT
if [ -z "$scheduler" ]; then
    "$place/bin/dask" scheduler --port 8786 --no-dashboard &
    scheduler=tcp://127.0.0.1:8786
fi
"$place/bin/dask" worker "$scheduler" --nworkers "$workers" --nthreads 1 --no-dashboard &
wait
