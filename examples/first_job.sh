#!/usr/bin/env bash
# Turns a video into a cartoon with curl and a running `impasto serve`.
#   examples/first_job.sh clip.mp4 cartoon.mp4 [http://127.0.0.1:8420]
set -euo pipefail
in=$1 out=$2 api=${3:-http://127.0.0.1:8420}/v1

field() { python3 -c 'import json, sys; print(json.load(sys.stdin)[sys.argv[1]])' "$1"; }

video=$(curl -sS --fail-with-body -F "file=@$in" "$api/assets" | field id)
job=$(curl -sS --fail-with-body -H 'Content-Type: application/json' \
  -d "{\"method\": \"abstraction\", \"inputs\": {\"video\": \"$video\"}}" "$api/jobs" | field id)
echo "job $job"

curl -sSN "$api/jobs/$job/events" | grep --line-buffered '^event: job' || true # ends when the job does

curl -sS --fail-with-body -o "$out.part" "$api/jobs/$job/result"
mv "$out.part" "$out"
echo "$out"
