# Builds one static binary and puts it alone into an image; the classic builder and BuildKit both do.
FROM rust:1-slim-bookworm AS build
# Names every dependency inside the binary, for scanners.
RUN cargo install --locked --version 0.7.0 cargo-auditable
WORKDIR /src

# Dependencies are a layer of their own: editing sources does not build them again.
COPY Cargo.toml Cargo.lock ./
RUN mkdir -p src benches \
    && for file in build.rs src/main.rs; do echo 'fn main() {}' >$file; done \
    && touch src/lib.rs \
    && sed -n '/^\[\[bench\]\]/{n;s/name = "\(.*\)"/benches\/\1.rs/p}' Cargo.toml | xargs -r touch \
    && rustc -vV | sed -n 's/^host: //p' >/target \
    && RUSTFLAGS='-C target-feature=+crt-static' cargo build --release --locked --target "$(cat /target)"

COPY build.rs ./
COPY proto proto
COPY src src
RUN touch build.rs src/main.rs src/lib.rs \
    && RUSTFLAGS='-C target-feature=+crt-static' cargo auditable build --release --locked --target "$(cat /target)" \
    && install -D --strip "target/$(cat /target)/release/vrdp" /image/vrdp \
    && mkdir /image/data

FROM gcr.io/distroless/static-debian12:nonroot
LABEL org.opencontainers.image.title="vrdp" \
      org.opencontainers.image.description="Understands the physics in a video" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
# 65532 is "nonroot" there; a named volume on /data takes over the owner.
COPY --from=build --chown=65532:65532 /image /
USER 65532:65532
ENV VRDP_LISTEN=0.0.0.0:50051 VRDP_INSECURE=true VRDP_DATA_DIR=/data
VOLUME /data
EXPOSE 50051
HEALTHCHECK --interval=10s --timeout=3s --start-period=5s --retries=3 \
    CMD ["/vrdp", "health", "--server", "http://127.0.0.1:50051"]
ENTRYPOINT ["/vrdp"]
CMD ["serve"]
