//! Which program and which arithmetic wrote a trace.

use crate::num::NUMERIC_FINGERPRINT;
use crate::scene::Scene;
use std::collections::BTreeMap;

/// Largest difference of a number (m, rad, m/s, rad/s, s) between programs: rounding differs, and contacts amplify it.
pub const TOLERANCE: f64 = 1e-6;

/// The program that writes traces: its version and the kind of machine.
pub fn build() -> String {
    format!("{} {}-{}", env!("CARGO_PKG_VERSION"), std::env::consts::ARCH, std::env::consts::OS)
}

/// Key of the numeric fingerprint in the metadata.
const FINGERPRINT: &str = "numeric_fingerprint";

/// Why numbers of a trace with these metadata may differ from ours in their last digits, as one sentence. `None` if this
/// program wrote it: then all bytes must be equal.
pub fn origin_difference(metadata: &BTreeMap<String, String>) -> Option<String> {
    let within = format!("numbers are compared within {TOLERANCE:e}, not bit for bit");
    let (wrote, ours) = (metadata.get("build").map_or("", String::as_str), build());
    let fingerprint = NUMERIC_FINGERPRINT.as_str();
    match metadata.get(FINGERPRINT) {
        Some(found) if found != fingerprint => Some(format!(
            "the trace was computed with other arithmetic (fingerprint {found}, this program has \
             {fingerprint}): sin, cos, exp and the like return other last digits there, so {within}"
        )),
        None => Some(format!(
            "the trace names no arithmetic, because an older program ({wrote:?}) wrote it, so {within}"
        )),
        Some(_) if wrote != ours => {
            Some(format!("the trace was written by {wrote:?}, this program is {ours:?}, so {within}"))
        }
        Some(_) => None,
    }
}

/// The metadata that all kinds of trace have.
pub fn metadata(kind: &str, scene: &Scene, video: &str, model: &str) -> BTreeMap<String, String> {
    [
        ("build", build()),
        (FINGERPRINT, NUMERIC_FINGERPRINT.as_str().to_string()),
        ("kind", kind.to_string()),
        ("scene", scene.name.clone()),
        ("video", video.to_string()),
        ("model", model.to_string()),
    ]
    .map(|(key, value)| (key.to_string(), value))
    .into()
}
