//! The version of the program, and what else its numbers depend on.

use crate::num::NUMERIC_FINGERPRINT;
use std::env::consts::{ARCH, OS};

/// `vrdp 0.1.0`; `verbose` adds lines for the numeric fingerprint, the features and the target.
pub fn version(verbose: bool) -> String {
    let version = format!("vrdp {}\n", env!("CARGO_PKG_VERSION"));
    if !verbose {
        return version;
    }
    let features: &[&str] = if cfg!(feature = "otlp") { &["otlp"] } else { &[] };
    let features = if features.is_empty() { "none".into() } else { features.join(", ") };
    format!(
        "{version}numeric fingerprint: {}\nfeatures: {features}\ntarget: {ARCH}-{OS}\n",
        *NUMERIC_FINGERPRINT
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_verbose_version_starts_with_the_short_one() {
        let (short, long) = (version(false), version(true));
        assert_eq!(short, format!("vrdp {}\n", env!("CARGO_PKG_VERSION")));
        let names: Vec<&str> =
            long.lines().skip(1).filter_map(|line| Some(line.split_once(": ")?.0)).collect();
        assert!(long.starts_with(&short));
        assert_eq!(names, ["numeric fingerprint", "features", "target"]);
        assert!(long.contains(NUMERIC_FINGERPRINT.as_str()));
    }
}
