#!/usr/bin/env bash
# Tests the deployment with a real Docker engine: build, start without privileges, questions from another container, restart,
# replay of a trace, metrics of the dashboard, stop, TLS. Images that cannot be pulled are replaced by stand-ins of their name.
set -euo pipefail
cd "$(dirname "$0")/.."

work=$(mktemp -d)
export COMPOSE_PROJECT_NAME=vrdp-test COMPOSE_FILE=deploy/compose.yaml VRDP_TLS_DIR=$work/tls VRDP_HOST=vrdp.example
mkdir "$VRDP_TLS_DIR"
root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
compose() { if docker compose version >/dev/null 2>&1; then docker compose "$@"; else docker-compose "$@"; fi; }
finish() {
    compose --profile monitoring down -v --remove-orphans >/dev/null 2>&1 || true
    root rm -rf "$work"
}
trap finish EXIT
step() { printf '\n== %s\n' "$*"; }
tenths() { echo $(($(date +%s%N) / 100000000)); }
since() { echo "$(($(tenths) - $1))" | sed 's/\(.\)$/.\1/; s/^\./0./'; }

# Whether the image exists or can be pulled; a stand-in with crates counts only if its crates are the current ones.
crates=$({ cat Cargo.lock; grep cargo-auditable Dockerfile; rustc -vV; } | sha256sum | cut -c1-16)
has() {
    local labels
    if labels=$(docker image inspect -f '{{json .Config.Labels}}' "$1" 2>/dev/null); then
        [[ $labels != *stand-in.crates* || $labels == *$crates* ]]
    else
        timeout 600 docker pull -q "$1" >/dev/null 2>&1
    fi
}
image() { grep -ho "$1[^ \"]*" Dockerfile deploy/compose.yaml | head -n 1; }
# Builds $1 from the Dockerfile on standard input, with the files that the other arguments name for tar.
stand_in() {
    local name=$1
    shift
    echo "$name: a stand-in"
    cat >"$work/Dockerfile"
    root tar -c -C "$work" Dockerfile "$@" | docker build -q --network none -t "$name" - >/dev/null 2>"$work/log" ||
        { cat "$work/log"; exit 1; }
}

step "base images"
rust=$(image rust:) distroless=$(image gcr.io/) prometheus=$(image prom/) python=python:3.11-slim-bookworm
debian=vrdp-test/debian
if ! { has "$rust" && has "$python"; } && ! docker image inspect $debian >/dev/null 2>&1; then
    command -v debootstrap >/dev/null || { root apt-get update -qq; root apt-get install -y -qq debootstrap >/dev/null; }
    root debootstrap --variant=minbase --include=gcc,libc6-dev,ca-certificates,python3 bookworm "$work/debian" \
        >"$work/log" || { tail "$work/log"; exit 1; }
    root tar -C "$work/debian" -c . | docker import - $debian >/dev/null
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
LABEL stand-in.crates=$crates
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
    root apt-get update -qq
    (cd "$work" && apt-get download -qq prometheus 2>/dev/null && dpkg -x prometheus_*.deb prometheus)
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
compose build --build-arg PROFILE=release >"$work/log" 2>&1 || { tail -n 40 "$work/log"; exit 1; }
size=$(docker image inspect -f '{{.Size}}' vrdp)
echo "built in $(since "$begin") s; image: $size bytes"
[ "$size" -le 50000000 ]
id=$(docker create vrdp)
docker cp "$id:/vrdp" "$work/vrdp" 2>/dev/null
docker rm "$id" >/dev/null
python3 - "$work/vrdp" <<'END'
import json, re, sys, zlib
binary = memoryview(open(sys.argv[1], "rb").read())
for match in re.finditer(rb"x[\x01\x5e\x9c\xda]", binary):
    try:
        text = zlib.decompressobj().decompress(binary[match.start() :], 1 << 20)
    except zlib.error:
        continue
    if text.startswith(b'{"packages"'):
        packages = json.loads(text)["packages"]
        break
else:
    sys.exit("the binary does not name its dependencies")
assert any(p["name"] == "tonic" for p in packages), packages
print(f"the binary names its {len(packages)} packages")
END
# Without tokens or an authority for clients it must refuse to start.
timeout 20 docker run --rm vrdp >"$work/log" 2>&1 || true
grep -e --insecure "$work/log"

# Starts it and waits for at most a minute.
start() {
    local begin
    begin=$(tenths)
    compose up -d
    id=$(compose ps -q vrdp)
    for _ in $(seq 300); do
        ! docker logs "$id" 2>&1 | grep -q "serves HTTP" || break
        sleep 0.2
    done
    echo "serves after $(since "$begin") s, the start of the container included"
    healthy
    echo "healthy after $(since "$begin") s"
}
healthy() {
    for _ in $(seq 300); do
        [ "$(docker inspect -f '{{.State.Health.Status}}' "$id")" != healthy ] || return 0
        sleep 0.2
    done
    docker inspect -f '{{json .State}}' "$id"
    docker logs "$id"
    exit 1
}
step "start: read-only, no capabilities, not root"
start
[ "$(docker inspect -f '{{.HostConfig.ReadonlyRootfs}} {{.HostConfig.CapDrop}} {{.Config.User}}' "$id")" = "true [ALL] 65532:65532" ]
docker stats --no-stream --format 'memory at rest: {{.MemUsage}}' "$id"
python3 -c "
import urllib.request
for page in ('healthz', 'metrics'):
    assert urllib.request.urlopen('http://127.0.0.1:8080/' + page, timeout=5).status == 200"

step "questions from another container"
python3 -m pip wheel -q --no-deps -w "$work" ./clients/python
python3 -m pip install -q --target "$work/site" --python-version 3.11 --only-binary=:all: "$work"/vrdp-*.whl
ask() {
    docker run --rm --network ${COMPOSE_PROJECT_NAME}_default -e PYTHONPATH=/site -v "$work/site:/site:ro" \
        -v "$PWD/deploy:/deploy:ro" -v "$VRDP_TLS_DIR:/tls:ro" "$python" python3 /deploy/test.py "$@"
}
ask first

step "a restart loses nothing"
compose restart -t 15 vrdp
healthy
ask again

step "a trace from the volume replays"
trace=$(docker run --rm --volumes-from "$id" "$python" sh -c 'ls /data/traces/*.mcap | head -n 1')
docker run --rm --volumes-from "$id" --read-only vrdp replay "$trace" --verify

step "Prometheus reads it, and every panel of the dashboard has figures"
compose --profile monitoring up -d prometheus
ask dashboard

step "stop"
begin=$(tenths)
compose stop vrdp
echo "stopped after $(since "$begin") s"
[ $(($(tenths) - begin)) -lt 100 ]
[ "$(docker inspect -f '{{.State.ExitCode}}' "$id")" = 0 ]

step "TLS and tokens"
new="openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 1"
$new -subj /CN=authority -keyout "$work/ca.key" -out "$VRDP_TLS_DIR/ca.pem" 2>/dev/null
$new -subj /CN=vrdp -addext "subjectAltName=DNS:vrdp,DNS:$VRDP_HOST" -addext basicConstraints=critical,CA:FALSE \
    -CA "$VRDP_TLS_DIR/ca.pem" -CAkey "$work/ca.key" -keyout "$VRDP_TLS_DIR/key.pem" -out "$VRDP_TLS_DIR/cert.pem" 2>/dev/null
echo "token-of-lab-a-0123456789 = lab-a" >"$VRDP_TLS_DIR/tokens"
chmod 644 "$VRDP_TLS_DIR"/*
COMPOSE_FILE=$COMPOSE_FILE:deploy/compose.tls.yaml
start
ask tls
echo "deployment: all checks passed"
