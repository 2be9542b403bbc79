//! How often what results depend on was deleted: a part of their keys in memory, so that nothing deleted is found there.

use super::locked;
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Most videos whose deletions are counted one by one.
const MOST_COUNTED: usize = 10_000;

/// Counts of deletions and damages, by whole key of a video, and by the part of the keys that names a tenant.
#[derive(Clone, Default)]
pub struct Deletions(Arc<Mutex<DeletionCounts>>);

#[derive(Default)]
struct DeletionCounts {
    of_all: u64,
    by_key: HashMap<String, u64>,
}

impl Deletions {
    /// Counts a deletion of what has that whole key.
    pub fn add(&self, key: String) {
        let mut counts = locked(&self.0);
        if counts.by_key.len() >= MOST_COUNTED {
            // Their sums must not come back, so all results are dropped once.
            counts.of_all += counts.by_key.drain().map(|(_, count)| count).sum::<u64>();
        }
        *counts.by_key.entry(key).or_default() += 1;
    }

    /// The count of results that depend on all of these; it rises with each deletion of one.
    pub fn count<'k>(&self, keys: impl IntoIterator<Item = &'k str>) -> u64 {
        let counts = locked(&self.0);
        counts.of_all + keys.into_iter().filter_map(|key| counts.by_key.get(key)).sum::<u64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_deletion_concerns_what_depends_on_it_only() {
        let deletions = Deletions::default();
        deletions.add("a".into());
        deletions.add("a".into());
        deletions.add("b".into());
        assert_eq!([deletions.count(["a"]), deletions.count(["c"]), deletions.count(["a", "b"])], [2, 0, 3]);
        let before = deletions.count(["a"]);
        for k in 0..MOST_COUNTED {
            deletions.add(format!("{k}"));
        }
        assert!(deletions.count(["a"]) > before && deletions.count(["c"]) > 0, "no count comes back");
        assert!(locked(&deletions.0).by_key.len() <= MOST_COUNTED);
    }
}
