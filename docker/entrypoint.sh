#!/usr/bin/env bash
# Entry point of the images: `service`, `worker` (joins a Ray cluster, or, without one, takes tasks from the stores),
# `head` (runs a cluster's head), or any command.
#
# A Ray driver must run on a node of the cluster, so a service on a cluster starts a node without processors. If either
# of the two ends, the container ends; otherwise it would seem healthy and do nothing.
set -euo pipefail

# Secrets may come as files: IMPASTO_ADMIN_KEY_FILE=/run/secrets/admin_key says where IMPASTO_ADMIN_KEY is.
for name in $(compgen -e | grep -E '^IMPASTO_[A-Z0-9_]+_FILE$' || true); do
    export "${name%_FILE}=$(<"${!name}")"
    unset "$name"
done

node=(ray start --block --disable-usage-stats --include-log-monitor=false)

join() {
    # The object store carries orders of a few kilobytes; blobs go by the store.
    exec "${node[@]}" --address="${IMPASTO_RAY_ADDRESS:?the address of the head, for example head:6379}" \
        --object-store-memory=$((256 << 20)) "$@"
}

joined() {
    # Whether `ray start`, the process $1, has reached the head and started this node's raylet. `ray health-check` says
    # only that there is a head, after 1.5 s of imports.
    local process
    for process in /proc/[0-9]*/stat; do
        [[ "$(cat "$process" 2>/dev/null)" == *" (raylet) "?" $1 "* ]] && return
    done
    return 1
}

case "${1:-}" in
    head)
        shift
        exec "${node[@]}" --head --port=6379 --num-cpus=0 --num-gpus=0 --dashboard-host=0.0.0.0 \
            --metrics-export-port=8080 --object-store-memory=$((256 << 20)) "$@"
        ;;
    worker)
        shift
        if [[ -z "${IMPASTO_RAY_ADDRESS:-}" ]]; then # no cluster: takes tasks from the stores by itself
            exec impasto worker "$@"
        fi
        join --metrics-export-port=8080 "$@"
        ;;
    service)
        shift
        if [[ -z "${IMPASTO_RAY_ADDRESS:-}" || "$IMPASTO_RAY_ADDRESS" == local ]]; then
            exec impasto serve "$@"
        fi
        export IMPASTO_POOL="${IMPASTO_POOL:-ray}"
        (join --num-cpus=0 --num-gpus=0) &
        ray=$!
        until joined "$ray"; do
            kill -0 "$ray" 2>/dev/null || exit 1
            sleep 1
        done
        impasto serve "$@" &
        serve=$!
        trap 'kill -TERM "$serve" 2>/dev/null || true' TERM INT
        while kill -0 "$serve" 2>/dev/null && kill -0 "$ray" 2>/dev/null; do
            sleep 1 &
            wait $! || true # a signal ends this wait, not the sleep
        done
        lost=0
        kill -0 "$ray" 2>/dev/null || lost=1
        kill -TERM "$serve" 2>/dev/null || true
        status=0
        wait "$serve" || status=$?
        kill -TERM "$ray" 2>/dev/null || true
        wait "$ray" || true
        exit $((lost ? 1 : status))
        ;;
    *)
        exec "$@"
        ;;
esac
