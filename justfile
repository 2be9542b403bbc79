# What CI runs.
check:
    .ci/run

demo:
    cargo run --release -- demo

bench:
    cargo bench
