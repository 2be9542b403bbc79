//! Slots that tenants share: bounded in all, and one tenant cannot hold all of them.
//!
//! The share of a tenant follows the dynamic thresholds of Choudhury and Hahne (1998): it may take a slot while it holds
//! less than [`SHARE_OF_FREE`] times the free ones. One tenant alone then gets two thirds of all slots, k greedy tenants
//! leave `1 / (1 + 2 k)` of them free, and the next tenant finds some. A service without named tenants gives all to its one.

use crate::engine::error::EngineError;
use crate::store::Tenant;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A tenant may hold this many times the free slots.
const SHARE_OF_FREE: usize = 2;

pub struct Admission {
    capacity: usize,
    held: Mutex<HeldSlots>,
}

#[derive(Default)]
struct HeldSlots {
    by_tenant: BTreeMap<Tenant, usize>,
    total: usize,
    /// Whether a named tenant has come.
    is_shared: bool,
}

impl Admission {
    pub fn new(capacity: usize) -> Arc<Admission> {
        Arc::new(Admission { capacity, held: Mutex::default() })
    }

    /// A slot for the tenant; an error at once if all slots, or its share of them, are taken.
    pub fn admit(self: &Arc<Self>, tenant: &Tenant) -> Result<QueueSlot, EngineError> {
        let mut held = self.held();
        held.is_shared |= !tenant.is_unnamed();
        let own = held.by_tenant.get(tenant).copied().unwrap_or(0);
        let free = self.capacity.saturating_sub(held.total);
        if free == 0 {
            return Err(EngineError::Overloaded { capacity: self.capacity });
        }
        if held.is_shared && own >= SHARE_OF_FREE * free {
            return Err(EngineError::ShareFull { share: own, capacity: self.capacity });
        }
        held.total += 1;
        *held.by_tenant.entry(tenant.clone()).or_default() += 1;
        Ok(QueueSlot { admission: self.clone(), tenant: tenant.clone() })
    }

    /// No code panics while it holds this lock.
    fn held(&self) -> MutexGuard<'_, HeldSlots> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One slot, free again when it is dropped.
pub struct QueueSlot {
    admission: Arc<Admission>,
    tenant: Tenant,
}

impl Drop for QueueSlot {
    fn drop(&mut self) {
        let mut held = self.admission.held();
        held.total -= 1;
        if let Some(own) = held.by_tenant.get_mut(&self.tenant) {
            *own -= 1;
            if *own == 0 {
                held.by_tenant.remove(&self.tenant);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes slots until one is refused.
    fn fill(admission: &Arc<Admission>, tenant: &Tenant) -> (Vec<QueueSlot>, EngineError) {
        let mut slots = vec![];
        loop {
            match admission.admit(tenant) {
                Ok(slot) => slots.push(slot),
                Err(refused) => return (slots, refused),
            }
        }
    }

    #[test]
    fn a_full_share_refuses_only_that_tenant() {
        let tenants: Vec<Tenant> = ["a", "b", "c"].map(|name| Tenant::new(name).unwrap()).into();
        let admission = Admission::new(90);
        let (first, refused) = fill(&admission, &tenants[0]);
        assert!(matches!(refused, EngineError::ShareFull { share: 60, capacity: 90 }), "{refused}");
        let (second, _) = fill(&admission, &tenants[1]);
        assert_eq!((first.len(), second.len()), (60, 20));
        let third = admission.admit(&tenants[2]).unwrap();
        assert!(admission.admit(&tenants[0]).is_err());
        drop((first, second, third));
        assert_eq!(fill(&admission, &tenants[2]).0.len(), 60);
        assert!(admission.held().by_tenant.is_empty() && admission.held().total == 0);
    }

    #[test]
    fn without_named_tenants_all_slots_are_free() {
        let admission = Admission::new(3);
        let (slots, refused) = fill(&admission, &Tenant::default());
        assert!(slots.len() == 3 && matches!(refused, EngineError::Overloaded { capacity: 3 }));
        assert!(admission.admit(&Tenant::new("a").unwrap()).is_err());
        drop(slots);
        assert_eq!(fill(&admission, &Tenant::default()).0.len(), 2, "a named tenant has come");
        let one = Admission::new(1);
        assert_eq!(fill(&one, &Tenant::new("a").unwrap()).0.len(), 1, "of one slot each may take it");
    }
}
