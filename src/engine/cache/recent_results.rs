//! Recent results in memory, bounded by bytes. All of them can be read or computed again.

use super::locked;
use quick_cache::Weighter;
use quick_cache::unsync::Cache;
use std::sync::{Arc, Mutex};

/// Bytes of a small result; it sets how many entries the cache makes room for.
pub const SMALL_RESULT: usize = 16 * 1024;

/// Estimates the bytes of a result.
struct Bytes<T>(fn(&T) -> usize);

impl<T> Weighter<String, Arc<T>> for Bytes<T> {
    fn weight(&self, _: &String, value: &Arc<T>) -> u64 {
        (self.0)(value) as u64
    }
}

type Entries<T> = Cache<String, Arc<T>, Bytes<T>>;

pub struct RecentResults<T>(Arc<Mutex<Entries<T>>>);

impl<T> Clone for RecentResults<T> {
    fn clone(&self) -> Self {
        RecentResults(self.0.clone())
    }
}

impl<T> RecentResults<T> {
    /// Keeps results of up to `bytes`; `weight` estimates the bytes of each.
    pub fn new(bytes: u64, weight: fn(&T) -> usize) -> Self {
        let entries = bytes as usize / SMALL_RESULT;
        RecentResults(Arc::new(Mutex::new(Cache::with_weighter(entries, bytes, Bytes(weight)))))
    }

    pub fn get(&self, key: &str) -> Option<Arc<T>> {
        locked(&self.0).get(key).cloned()
    }

    pub fn insert(&self, key: String, value: Arc<T>) {
        locked(&self.0).insert(key, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_keeps_what_fits_and_no_more() {
        let results = RecentResults::<usize>::new(1_000_000, |bytes| *bytes);
        for k in 0..100 {
            results.insert(format!("{k}"), Arc::new(100_000));
        }
        let kept = (0..100).filter(|k| results.get(&format!("{k}")).is_some()).count();
        assert!((5..=10).contains(&kept), "{kept} results of a tenth each");
        results.insert("huge".into(), Arc::new(2_000_000));
        assert_eq!(results.get("huge"), None);
    }
}
