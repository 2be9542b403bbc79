//! Compiles the protobuf files without protoc; the descriptors are kept for reflection.

use std::error::Error;
use std::path::PathBuf;

const FILES: [&str; 5] = [
    "vrdp/v1/common.proto",
    "vrdp/v1/videos.proto",
    "vrdp/v1/models.proto",
    "vrdp/v1/reasoning.proto",
    "vrdp/v1/traces.proto",
];

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=proto");
    let mut compiler = protox::Compiler::new(["proto"])?;
    compiler.include_imports(true).include_source_info(true).open_files(FILES)?;
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    std::fs::write(out.join("descriptors.bin"), compiler.encode_file_descriptor_set())?;
    tonic_prost_build::configure().compile_fds(compiler.file_descriptor_set())?;
    Ok(())
}
