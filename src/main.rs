//! The `vrdp` program.

fn main() -> std::process::ExitCode {
    vrdp::cli::main()
}
