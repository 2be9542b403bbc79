//! Content digests: the same content gives the same key on every machine.
//!
//! `key = hex(first 16 bytes of BLAKE3(n(f) f n(t) t v))`, with f the format, t the tag, `n(x)` the length of x in bytes (64 bits,
//! little endian, so that parts cannot run into each other) and v the canonical text of the value: compact JSON, fields in
//! declaration order, each float in its shortest form that reads back to the same bits, -0.0 as 0.0. Two different values
//! have equal keys with probability 2^-128. Source: O'Connor, Aumasson, Neves, Wilcox-O'Hearn, BLAKE3 (2020).

use crate::scene::observation::Scene;
use serde::Serialize;
use serde_json::ser::Formatter;
use std::io;

/// Change it whenever the canonical text of a value changes, so that old keys never match new ones.
const FORMAT: &str = "vrdp-1";

impl Scene {
    /// Key of this scene: 32 hex digits over all of its content, the name included.
    pub fn digest(&self) -> String {
        canonical_digest("scene", self)
    }
}

/// Key of any plain value with finite numbers: 32 hex digits. `tag` names the kind of value.
pub fn canonical_digest<T: Serialize>(tag: &str, value: &T) -> String {
    let mut hasher = blake3::Hasher::new();
    for part in [FORMAT, tag] {
        hasher.update(&(part.len() as u64).to_le_bytes());
        hasher.update(part.as_bytes());
    }
    let written = value.serialize(&mut serde_json::Serializer::with_formatter(&mut hasher, Canonical));
    if let Err(error) = written {
        // Only a map whose keys are not strings fails; the error's text then takes part in its key.
        hasher.update(error.to_string().as_bytes());
    }
    hasher.finalize().to_hex().as_str().chars().take(32).collect()
}

struct Canonical;

impl Formatter for Canonical {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        // Adding zero turns -0.0 into 0.0 and changes nothing else.
        write!(writer, "{:e}", value + 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_have_equal_digests_and_others_do_not() {
        let digest = |tag, values: &[f64]| canonical_digest(tag, &values);
        assert_eq!(digest("a", &[0.0, 1.5]), digest("a", &[-0.0, 1.5]));
        let others = [
            digest("a", &[0.0, 1.5]),
            digest("b", &[0.0, 1.5]),
            digest("a", &[0.0, 1.5 + f64::EPSILON]),
            digest("a", &[0.0, -1.5]),
            digest("a", &[1.5, 0.0]),
        ];
        for (i, a) in others.iter().enumerate() {
            assert_eq!(a.len(), 32);
            assert!(others[..i].iter().all(|b| a != b));
        }
    }
}
