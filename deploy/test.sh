#!/usr/bin/env bash
# Proves the deployment with a real Docker engine: build, a locked-down start, questions from another container, a restart, a
# trace that replays, a quick stop. Where base images cannot be pulled it makes stand-ins of the same names.
set -euo pipefail
cd "$(dirname "$0")/.."

export DOCKER_BUILDKIT=0
compose=$(docker compose version >/dev/null 2>&1 && echo "docker compose" || echo docker-compose)
compose="$compose -f deploy/compose.yaml -p vrdp-test"
work=$(mktemp -d)
root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
finish() {
    $compose down -v --remove-orphans >/dev/null 2>&1 || true
    root rm -rf "$work"
}
trap finish EXIT
step() { printf '\n== %s\n' "$*"; }
tenths() { echo $(($(date +%s%N) / 100000000)); }
since() { echo "$(($(tenths) - $1))" | sed "s/\(.\)$/.\1/; s/^\./0./"; }

has() { docker image inspect "$1" >/dev/null 2>&1 || timeout 60 docker pull -q "$1" >/dev/null 2>&1; }

# A small Debian with a C compiler and Python, made once.
debian() {
    [ -d "$work/debian" ] && return
    command -v debootstrap >/dev/null || { root apt-get update -qq; root apt-get install -y -qq debootstrap >/dev/null; }
    root debootstrap --variant=minbase --include=gcc,libc6-dev,ca-certificates,python3 \
        bookworm "$work/debian" >"$work/debootstrap.log" || { tail "$work/debootstrap.log"; exit 1; }
}

step "base images"
rust=$(sed -n 's/^FROM \(rust:[^ ]*\).*/\1/p' Dockerfile)
if ! has "$rust"; then
    echo "$rust: a stand-in with this machine's toolchain and crates"
    debian
    auditable=$(sed -n 's/.*--version \([0-9.]*\) cargo-auditable.*/\1/p' Dockerfile)
    cargo install -q --locked --version "$auditable" --root "$work/cargo" cargo-auditable
    cargo fetch -q --locked
    home=${CARGO_HOME:-$HOME/.cargo}
    root mkdir -p "$work/rust/usr/local/cargo"
    root cp -a "$work/debian/." "$work/rust/"
    root cp -a "$(rustc --print sysroot)" "$work/rust/usr/local/toolchain"
    root cp -a "$work/cargo/." "$work/rust/usr/local/cargo/"
    root cp -a "$home/registry" "$work/rust/usr/local/cargo/"
    for file in config.toml config; do [ ! -f "$home/$file" ] || root cp "$home/$file" "$work/rust/usr/local/cargo/"; done
    root tar -C "$work/rust" -c . | docker import -c 'ENV CARGO_HOME=/usr/local/cargo CARGO_NET_OFFLINE=true' \
        -c 'ENV PATH=/usr/local/cargo/bin:/usr/local/toolchain/bin:/usr/sbin:/usr/bin:/sbin:/bin' - "$rust" >/dev/null
    root rm -rf "$work/rust"
fi
distroless=$(sed -n 's/^FROM \(gcr[^ ]*\).*/\1/p' Dockerfile)
if ! has "$distroless"; then
    echo "$distroless: a stand-in with its users and nothing else"
    mkdir -p "$work/static/etc" "$work/static/tmp" "$work/static/home/nonroot"
    chmod 1777 "$work/static/tmp"
    printf 'root:x:0:0:root:/root:/sbin/nologin\nnonroot:x:65532:65532:nonroot:/home/nonroot:/sbin/nologin\n' >"$work/static/etc/passwd"
    printf 'root:x:0:\nnonroot:x:65532:\n' >"$work/static/etc/group"
    tar -C "$work/static" --owner=0 --group=0 -c . | docker import - "$distroless" >/dev/null
fi
client=python:3.11-slim-bookworm
if ! has "$client"; then
    echo "$client: a stand-in"
    debian
    root tar -C "$work/debian" -c . | docker import - "$client" >/dev/null
fi

step "build"
$compose build
size=$(docker image inspect -f '{{.Size}}' vrdp)
echo "image: $((size / 1000000)) MB"
[ "$size" -le 50000000 ]

step "start: read-only, no capabilities, not root"
begin=$(tenths)
$compose up -d
id=$($compose ps -q vrdp)
until [ "$(docker inspect -f '{{.State.Health.Status}}' "$id")" = healthy ]; do sleep 0.2; done
echo "healthy after $(since "$begin") s"
[ "$(docker inspect -f '{{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}} {{.Config.User}}' "$id")" = "true [ALL] 65532:65532" ]
docker stats --no-stream --format 'memory at rest: {{.MemUsage}}' "$id"

step "questions from another container"
python3 -m pip install -q --target "$work/site" ./clients/python
ask() {
    docker run --rm --network container:"$id" -e PYTHONPATH=/site -v "$work/site:/site:ro" -v "$PWD/deploy:/deploy:ro" \
        "$client" python3 /deploy/test.py "$@"
}
ask first

step "a restart loses nothing"
$compose restart -t 15 vrdp
until [ "$(docker inspect -f '{{.State.Health.Status}}' "$id")" = healthy ]; do sleep 0.2; done
ask again

step "a trace from the volume replays"
trace=$(docker run --rm --volumes-from "$id" "$client" sh -c 'ls /data/traces/*.mcap | head -n 1')
docker run --rm --volumes-from "$id" --read-only vrdp replay "$trace" --verify

step "stop"
begin=$(tenths)
$compose stop
echo "stopped after $(since "$begin") s"
[ $(($(tenths) - begin)) -lt 100 ]
[ "$(docker inspect -f '{{.State.ExitCode}}' "$id")" = 0 ]
echo "deployment: all well"
