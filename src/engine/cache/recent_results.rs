//! Recent results in memory, bounded by bytes. All of them can be read or computed again.
//!
//! Tenants share the bytes fairly: where there are too many, those leave first that the tenant with the most bytes has not used for
//! longest. So a tenant that holds no more than an equal part loses nothing to the others.

use super::locked;
use crate::store::Tenant;
use quick_cache::Weighter;
use quick_cache::unsync::Cache;
use std::collections::HashMap;
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

/// The results of all tenants.
struct Shares<T> {
    tenants: HashMap<Tenant, Entries<T>>,
    /// Most bytes of all of them.
    limit: u64,
    weight: fn(&T) -> usize,
}

pub struct RecentResults<T>(Arc<Mutex<Shares<T>>>);

impl<T> Clone for RecentResults<T> {
    fn clone(&self) -> Self {
        RecentResults(self.0.clone())
    }
}

impl<T> RecentResults<T> {
    /// Keeps results of up to `bytes`; `weight` estimates the bytes of each.
    pub fn new(bytes: u64, weight: fn(&T) -> usize) -> Self {
        RecentResults(Arc::new(Mutex::new(Shares { tenants: HashMap::new(), limit: bytes, weight })))
    }

    pub fn get(&self, key: &str) -> Option<Arc<T>> {
        locked(&self.0).tenants.get(&Tenant::of_key(key))?.get(key).cloned()
    }

    pub fn insert(&self, key: String, value: Arc<T>) {
        locked(&self.0).insert(key, value);
    }
}

impl<T> Shares<T> {
    fn insert(&mut self, key: String, value: Arc<T>) {
        let (limit, weight) = (self.limit, self.weight);
        let entries = || Cache::with_weighter(limit as usize / SMALL_RESULT, limit, Bytes(weight));
        let own = self.tenants.entry(Tenant::of_key(&key)).or_insert_with(entries);
        own.set_capacity(limit);
        own.insert(key, value);
        self.divide();
    }

    /// Takes from the tenant with the most bytes, down to the next one, until all have no more than the limit.
    fn divide(&mut self) {
        loop {
            let mut shares: Vec<&mut Entries<T>> = self.tenants.values_mut().collect();
            shares.sort_by_key(|share| std::cmp::Reverse(share.weight()));
            let bytes = shares.iter().map(|share| share.weight()).sum::<u64>();
            let next = shares.get(1).map_or(0, |share| share.weight());
            let Some(largest) = shares.first_mut().filter(|_| bytes > self.limit) else { return };
            let before = largest.weight();
            // Of two equal ones, one gives what is too much.
            let most = (before - (bytes - self.limit).min(before)).max(next.min(before - 1));
            largest.set_capacity(most);
            if largest.weight() == before {
                largest.clear();
            }
        }
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

    #[test]
    fn a_tenant_with_less_than_its_part_loses_nothing() {
        let results = RecentResults::<usize>::new(1_000_000, |bytes| *bytes);
        let kept =
            |tenant: &str| (0..200).filter(|k| results.get(&format!("~{tenant}/{k}")).is_some()).count();
        // Alone, a tenant may have everything.
        (0..10).for_each(|k| results.insert(format!("~a/{k}"), Arc::new(90_000)));
        assert!(kept("a") >= 9, "{}", kept("a"));
        for k in 0..200 {
            results.insert(format!("~b/{k}"), Arc::new(10_000));
        }
        assert!((4..=6).contains(&kept("a")), "{} of a", kept("a"));
        assert!((40..=60).contains(&kept("b")), "{} of b", kept("b"));
        // A third takes its part from both.
        (0..200).for_each(|k| results.insert(format!("~c/{k}"), Arc::new(10_000)));
        assert!((25..=40).contains(&kept("b")) && (25..=40).contains(&kept("c")) && kept("a") >= 3);
    }
}
