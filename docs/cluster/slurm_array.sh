#!/bin/bash
# One recording a task of a SLURM array; all share one ledger and one report.
#
#   ls -d /data/takes/*/ > recordings.txt
#   sbatch --array=1-$(wc -l < recordings.txt)%50 slurm_array.sh recordings.txt /data/batch
#
# The same line again goes on: what is done from the same inputs is left as it is.
#SBATCH --job-name=handtrack
#SBATCH --cpus-per-task=2
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --signal=TERM@120
set -eu
list=$1
out=$2
# kernels are compiled once for each type of processor, not by every task: run `handtrack warmup` on one node of each first
export NUMBA_CACHE_DIR="${NUMBA_CACHE_DIR:-$HOME/.cache/handtrack_kernels}"
export HANDTRACK_THREADS="${SLURM_CPUS_PER_TASK:-1}"
recording=$(sed -n "${SLURM_ARRAY_TASK_ID}p" "$list")
exec handtrack batch "$recording" --resume --out "$out"
