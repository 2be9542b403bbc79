# One static binary, alone in an image; the classic builder and BuildKit both do.
FROM rust:1-slim-bookworm AS build
# Names every dependency inside the binary, for scanners.
RUN cargo install --locked --version 0.7.0 cargo-auditable
WORKDIR /src
# `dist` optimises across crates, `release` each crate by itself.
ARG PROFILE=dist
# With --target they hold for the program alone, not for build scripts.
ENV RUSTFLAGS="-C target-feature=+crt-static"

# Dependencies are a layer of their own: editing sources does not build them again.
COPY Cargo.toml Cargo.lock ./
RUN mkdir -p src benches \
    && for file in build.rs src/main.rs; do echo 'fn main() {}' >$file; done \
    && touch src/lib.rs \
    && sed -n '/^\[\[bench\]\]/{n;s/name = "\(.*\)"/benches\/\1.rs/p}' Cargo.toml | xargs -r touch \
    && cargo auditable build --profile "$PROFILE" --locked --target "$(rustc --print host-tuple)"

COPY build.rs ./
COPY proto proto
COPY src src
# The scenes of `vrdp demo`.
COPY tests tests
RUN touch build.rs src/main.rs src/lib.rs \
    && cargo auditable build --profile "$PROFILE" --locked --target "$(rustc --print host-tuple)" \
    && mkdir -p /image /owned/data \
    && strip -o /image/vrdp target/*/"$PROFILE"/vrdp

FROM gcr.io/distroless/static-debian12:nonroot
LABEL org.opencontainers.image.title="vrdp" \
      org.opencontainers.image.description="Understands the physics in a video" \
      org.opencontainers.image.licenses="MIT OR Apache-2.0"
COPY --from=build /image /
# 65532 is "nonroot" there; a named volume on /data takes over the owner.
COPY --from=build --chown=65532:65532 /owned /
USER 65532:65532
# Reached from outside, it starts with a certificate and tokens, or where VRDP_INSECURE=true is said.
ENV VRDP_LISTEN=0.0.0.0:50051 VRDP_HTTP=0.0.0.0:8080 VRDP_DATA_DIR=/data
VOLUME /data
EXPOSE 50051 8080
HEALTHCHECK --interval=5s --timeout=3s --start-period=5s --retries=3 CMD ["/vrdp", "health"]
ENTRYPOINT ["/vrdp"]
CMD ["serve"]
