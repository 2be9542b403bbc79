#!/usr/bin/env bash
# Proves the deployment with a real Docker engine: build, a locked-down start, questions from another container, a restart, a
# trace that replays, the dashboard's figures, TLS, a quick stop. What cannot be pulled gets a stand-in of the same name.
set -euo pipefail
cd "$(dirname "$0")/.."

# The classic builder takes stand-ins, which BuildKit would look for in a registry.
export DOCKER_BUILDKIT=0 COMPOSE_DOCKER_CLI_BUILD=0
project=vrdp-test
work=$(mktemp -d)
root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
compose() {
    local command="docker-compose"
    ! docker compose version >/dev/null 2>&1 || command="docker compose"
    $command -p $project -f deploy/compose.yaml "$@"
}
finish() {
    compose --profile monitoring down -v --remove-orphans >/dev/null 2>&1 || true
    root rm -rf "$work"
}
trap finish EXIT
step() { printf '\n== %s\n' "$*"; }
tenths() { echo $(($(date +%s%N) / 100000000)); }
since() { echo "$(($(tenths) - $1))" | sed 's/\(.\)$/.\1/; s/^\./0./'; }

# Whether the image is there or can be pulled; a stand-in counts if it was made of the same things.
key=$({ cat Cargo.lock Dockerfile "$0"; rustc -vV; } | sha256sum | cut -c1-16)
has() {
    local labels
    if labels=$(docker image inspect -f '{{json .Config.Labels}}' "$1" 2>/dev/null); then
        [[ $labels != *vrdp.stand-in* || $labels == *$key* ]]
    else
        timeout 600 docker pull -q "$1" >/dev/null 2>&1
    fi
}
image() { grep -ho "$1[^ \"]*" Dockerfile deploy/compose.yaml | head -n 1; }
# Builds the Dockerfile on standard input, with the files that the arguments tell tar, as $1.
stand_in() {
    local name=$1
    shift
    echo "$name: a stand-in"
    { cat && echo "LABEL vrdp.stand-in=$key"; } >"$work/Dockerfile"
    root tar -c -C "$work" Dockerfile "$@" | docker build -q --network none -t "$name" - >/dev/null
}

step "base images"
rust=$(image rust:) distroless=$(image gcr.io/) prometheus=$(image prom/) python=python:3.11-slim-bookworm
debian=vrdp-test/debian
if ! { has "$rust" && has "$python"; } && ! has $debian; then
    command -v debootstrap >/dev/null || { root apt-get update -qq; root apt-get install -y -qq debootstrap >/dev/null; }
    root debootstrap --variant=minbase --include=gcc,libc6-dev,ca-certificates,python3 bookworm "$work/debian" \
        >"$work/log" || { tail "$work/log"; exit 1; }
    root tar -C "$work/debian" -c . | docker import -c "LABEL vrdp.stand-in=$key" - $debian >/dev/null
    root rm -rf "$work/debian"
fi
has "$python" || docker tag $debian "$python"
if ! has "$rust"; then
    # This machine's toolchain and crates: the build needs no network.
    version=$(sed -n 's/.*--version \([0-9.]*\) cargo-auditable.*/\1/p' Dockerfile)
    cargo install -q --locked --version "$version" --root "$work/auditable" cargo-auditable
    cargo fetch -q --locked
    home=${CARGO_HOME:-$HOME/.cargo}
    settings=$(cd "$home" && ls config.toml config 2>/dev/null || true)
    stand_in "$rust" --exclude=rustlib/src --exclude=registry/src -C "$(rustc --print sysroot)" bin/cargo bin/rustc lib \
        -C "$home" registry $settings -C "$work" auditable <<END
FROM $debian
ENV CARGO_HOME=/usr/local/cargo CARGO_NET_OFFLINE=true PATH=/usr/local/cargo/bin:/usr/local/bin:/usr/bin:/bin
COPY bin /usr/local/bin
COPY lib /usr/local/lib
COPY registry /usr/local/cargo/registry
COPY $settings auditable /usr/local/cargo/
END
fi
if ! has "$distroless"; then
    # Its users, and nothing else.
    mkdir -p "$work/etc"
    echo 'nonroot:x:65532:65532::/home/nonroot:/sbin/nologin' >"$work/etc/passwd"
    echo 'nonroot:x:65532:' >"$work/etc/group"
    stand_in "$distroless" -C "$work" etc <<END
FROM scratch
COPY etc /etc
END
fi
if ! has "$prometheus"; then
    (cd "$work" && apt-get download -qq prometheus && dpkg -x prometheus_*.deb prometheus)
    stand_in "$prometheus" -C "$work/prometheus" usr/bin/prometheus <<END
FROM $debian
COPY usr/bin/prometheus /bin/prometheus
RUN mkdir /prometheus && chown 65534:65534 /prometheus
USER 65534
VOLUME /prometheus
ENTRYPOINT ["/bin/prometheus"]
CMD ["--config.file=/etc/prometheus/prometheus.yml", "--storage.tsdb.path=/prometheus"]
END
fi

step "build"
begin=$(tenths)
compose build
size=$(docker image inspect -f '{{.Size}}' vrdp)
echo "built in $(since "$begin") s; image: $((size / 100000))e5 bytes"
[ "$size" -le 50000000 ]
