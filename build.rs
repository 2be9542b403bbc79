//! Compiles the protobuf files without protoc; the descriptors are kept for reflection and for trace files.

use std::error::Error;
use std::path::{Path, PathBuf};

const SERVICES: [&str; 9] = [
    "vrdp/v1/common.proto",
    "vrdp/v1/concepts.proto",
    "vrdp/v1/videos.proto",
    "vrdp/v1/discovery.proto",
    "vrdp/v1/models.proto",
    "vrdp/v1/operations.proto",
    "vrdp/v1/reasoning.proto",
    "vrdp/v1/statistics.proto",
    "vrdp/v1/traces.proto",
];

/// Messages in a trace; each file's descriptors become the schema of its messages.
const RECORDING: [&str; 5] = [
    "foxglove/pose.proto",
    "foxglove/scene.proto",
    "foxglove/image.proto",
    "foxglove/log.proto",
    "vrdp/v1/recording.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    services(&out)?;
    recording(&out.join("recording"))
}

fn services(out: &Path) -> Result<(), Box<dyn Error>> {
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(SERVICES)?;
    std::fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    tonic_prost_build::configure().compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}

/// Trace messages are compiled apart from the services: a recording knows nothing of the interface.
fn recording(out: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(out)?;
    for file in RECORDING {
        let mut one = protox::Compiler::new(["proto"])?;
        one.include_imports(true).open_file(file)?;
        let stem = Path::new(file).file_stem().unwrap_or_default();
        std::fs::write(out.join(stem).with_extension("bin"), one.encode_file_descriptor_set())?;
    }
    prost_build::Config::new().out_dir(out).compile_fds(protox::compile(RECORDING, ["proto"])?)?;
    Ok(())
}
