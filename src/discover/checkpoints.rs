//! What a discovery has computed so far: one that is cut short goes on from there.
//!
//! A discovery is a fixed sequence of steps, most of them searches and fits. The result of a step depends on its inputs alone, so it
//! is kept under their digest. The same discovery, computed again, takes what is kept and computes the rest: it finds the same,
//! bit for bit.

use super::weak_form::WeakFormRegression;
use crate::scene::canonical_digest;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Where the results of a discovery's steps are kept while it runs, as CBOR.
pub trait Checkpoints: Sync {
    /// The result that was kept under this digest.
    fn find(&self, digest: &str) -> Option<Vec<u8>>;

    fn keep(&self, digest: &str, result: Vec<u8>);
}

impl WeakFormRegression<'_> {
    /// The result of a step that depends on `inputs` alone: the one that was kept, or what `make` makes.
    pub fn step<I: Serialize, T: Serialize + DeserializeOwned, E>(
        &self,
        name: &str,
        inputs: &I,
        make: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E> {
        let Some(checkpoints) = self.checkpoints else { return make() };
        let digest = canonical_digest(name, inputs);
        let kept = checkpoints.find(&digest);
        if let Some(kept) = kept.and_then(|bytes| ciborium::from_reader(bytes.as_slice()).ok()) {
            return Ok(kept);
        }
        let made = make()?;
        let mut bytes = vec![];
        // What a stopped search leaves has no meaning.
        if ciborium::into_writer(&made, &mut bytes).is_ok() && !self.is_stopped() {
            checkpoints.keep(&digest, bytes);
        }
        Ok(made)
    }
}

/// An effect of the library by its name.
pub mod effect_by_name {
    use crate::effects::{EffectEntry, effect};
    use serde::de::{Deserialize, Deserializer, Error};
    use serde::ser::Serializer;

    pub fn serialize<S: Serializer>(entry: &&'static EffectEntry, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(entry.spec.name)
    }

    pub fn deserialize<'d, D: Deserializer<'d>>(from: D) -> Result<&'static EffectEntry, D::Error> {
        let name = String::deserialize(from)?;
        effect(&name).ok_or_else(|| D::Error::custom(format!("the library has no effect {name:?}")))
    }
}

#[cfg(test)]
mod tests {
    use crate::discover::tests::{film, launches, models};
    use crate::discover::*;
    use crate::fit::FitError;
    use crate::num::{Stopped, never};
    use std::collections::HashMap;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Default)]
    struct Kept {
        rows: Mutex<HashMap<String, Vec<u8>>>,
        found: AtomicUsize,
    }

    impl Checkpoints for Kept {
        fn find(&self, digest: &str) -> Option<Vec<u8>> {
            let row = self.rows.lock().expect("nobody panicked").get(digest).cloned();
            self.found.fetch_add(usize::from(row.is_some()), Ordering::Relaxed);
            row
        }

        fn keep(&self, digest: &str, row: Vec<u8>) {
            let mut rows = self.rows.lock().expect("nobody panicked");
            // Two threads may compute the same step at the same time.
            if let Some(old) = rows.insert(digest.into(), row.clone()) {
                assert_eq!(old, row);
            }
        }
    }

    /// Cut short at several places, it computes no step twice and gives the same bits.
    #[test]
    fn a_discovery_goes_on_from_the_steps_that_were_kept() {
        let scenes = film(&launches(), Some(("coriolis", &[("Omega", 0.12)])));
        let (models, options) = (models(&scenes), DiscoverOptions::default());
        let whole = discover(&scenes, &models, &options, &never).expect("it runs");
        let kept = Kept::default();
        let count = || kept.rows.lock().expect("nobody panicked").len();
        for most in [1, 2, 5, 12] {
            let stop = |_: f64| if count() < most { Ok(()) } else { Err(Stopped) };
            let cut = discover_with(&scenes, &models, &options, Some(&kept), &stop);
            assert!(matches!(cut, Err(FitError::Stopped(_))) && count() >= most, "{} steps", count());
        }
        let before = (count(), kept.found.load(Ordering::Relaxed));
        let resumed = discover_with(&scenes, &models, &options, Some(&kept), &never).expect("it runs");
        assert_eq!(resumed, whole);
        let again = kept.found.load(Ordering::Relaxed) - before.1;
        assert!(again >= before.0, "{again} of {} were found", before.0);
        let bytes: usize = kept.rows.lock().expect("nobody panicked").values().map(Vec::len).sum();
        println!("{bytes} bytes, {} steps, {} kept at the last cut", count(), before.0);
    }
}
