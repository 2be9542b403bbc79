//! Budgets in bytes: how much memory messages in flight may take, in all and for each caller.

use crate::api::status::busy;
use crate::engine::Tenant;
use crate::media::MAX_VIDEO_BYTES;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio_util::sync::CancellationToken;
use tonic::Status;

/// Bytes that were reserved so long ago may be taken from a connection that does not read its replies.
const STALLED_AFTER: Duration = Duration::from_secs(10);

/// Budgets of memory.
#[derive(Clone)]
pub struct Budgets {
    pub requests: ByteBudget,
    /// Of files of videos that are imported.
    pub imports: ByteBudget,
    pub replies: ByteBudget,
}

impl Budgets {
    /// Bytes of requests and of replies; one holder has at most a half.
    pub fn new(request_bytes: usize, reply_bytes: usize) -> Budgets {
        let halves = |total: usize| ByteBudget::new(total, total / 2 + PREFIX);
        Budgets {
            requests: halves(request_bytes),
            imports: halves(2 * MAX_VIDEO_BYTES),
            replies: halves(reply_bytes),
        }
    }
}

/// Bytes before each message: a flag of compression and the length.
pub const PREFIX: usize = 5;

/// Who holds bytes: a tenant, or the connection of a caller without one.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum Holder {
    Tenant(Tenant),
    Connection(u64),
}

impl Holder {
    /// The tenant; where there is none, the connection. Callers without either are one.
    pub fn of(tenant: Option<&Tenant>, connection: Option<u64>) -> Holder {
        match tenant {
            Some(tenant) => Holder::Tenant(tenant.clone()),
            None => Holder::Connection(connection.unwrap_or_default()),
        }
    }
}

/// A number of bytes that reservations share.
#[derive(Clone)]
pub struct ByteBudget {
    total: usize,
    /// Most bytes of one holder.
    share: usize,
    state: Arc<Mutex<BudgetState>>,
}

#[derive(Default)]
struct BudgetState {
    used: usize,
    last: u64,
    by_holder: BTreeMap<Holder, usize>,
    /// Reservations that may be taken back by closing their connection, by their numbers: the oldest is the first.
    closable: BTreeMap<u64, (Instant, CancellationToken)>,
}

/// Why bytes were refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum OverBudget {
    #[error("all callers together have {total} bytes in flight, and {bytes} more do not fit")]
    Total { bytes: usize, total: usize },
    #[error("this caller has {share} bytes in flight, its share, and {bytes} more do not fit")]
    Share { bytes: usize, share: usize },
}

impl OverBudget {
    /// The refusal, with what helps.
    pub fn refusal(self, advice: &str) -> Status {
        busy(format!("{self}; {advice}"), "BYTES_IN_FLIGHT")
    }
}

impl From<OverBudget> for Status {
    fn from(over: OverBudget) -> Status {
        over.refusal("try again later")
    }
}

/// Bytes of a budget until it is dropped.
pub struct ReservedBytes {
    budget: ByteBudget,
    holder: Holder,
    bytes: usize,
    number: u64,
}

impl ByteBudget {
    /// `total` bytes, of which one holder has at most `share`.
    pub fn new(total: usize, share: usize) -> ByteBudget {
        ByteBudget { total, share: share.min(total), state: Arc::default() }
    }

    /// No code panics while it holds this lock.
    fn state(&self) -> MutexGuard<'_, BudgetState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bytes in use.
    pub fn used(&self) -> usize {
        self.state().used
    }

    /// Reserves bytes, or says at once which limit they exceed.
    pub fn reserve(&self, holder: &Holder, bytes: usize) -> Result<ReservedBytes, OverBudget> {
        self.reserve_number(holder, bytes, None)
    }

    /// Reserves bytes of a reply. If they do not fit, the connection of the oldest reply that nobody reads is closed.
    pub fn reserve_closable(
        &self,
        holder: &Holder,
        bytes: usize,
        close: &CancellationToken,
    ) -> Result<ReservedBytes, OverBudget> {
        self.reserve_number(holder, bytes, Some(close))
    }

    fn reserve_number(
        &self,
        holder: &Holder,
        bytes: usize,
        close: Option<&CancellationToken>,
    ) -> Result<ReservedBytes, OverBudget> {
        let mut state = self.state();
        let held = state.by_holder.get(holder).copied().unwrap_or(0);
        let refusal = if bytes > self.share.saturating_sub(held) {
            Some(OverBudget::Share { bytes, share: self.share })
        } else if bytes > self.total.saturating_sub(state.used) {
            Some(OverBudget::Total { bytes, total: self.total })
        } else {
            None
        };
        if let Some(refusal) = refusal {
            if let Some((since, close)) = state.closable.values().next()
                && since.elapsed() > STALLED_AFTER
            {
                close.cancel();
            }
            return Err(refusal);
        }
        state.used += bytes;
        state.last += 1;
        let number = state.last;
        *state.by_holder.entry(holder.clone()).or_default() += bytes;
        if let Some(close) = close {
            state.closable.insert(number, (Instant::now(), close.clone()));
        }
        Ok(ReservedBytes { budget: self.clone(), holder: holder.clone(), bytes, number })
    }
}

impl Drop for ReservedBytes {
    fn drop(&mut self) {
        let mut state = self.budget.state();
        state.used = state.used.saturating_sub(self.bytes);
        state.closable.remove(&self.number);
        if let Some(held) = state.by_holder.get_mut(&self.holder) {
            *held = held.saturating_sub(self.bytes);
            if *held == 0 {
                state.by_holder.remove(&self.holder);
            }
        }
    }
}

/// Reservations of one call, held by whoever still has its bytes.
#[derive(Clone, Default)]
pub struct HeldBytes(Arc<Mutex<Vec<ReservedBytes>>>);

impl HeldBytes {
    /// Adds a reservation.
    pub fn add(&self, bytes: ReservedBytes) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(bytes);
    }

    /// Keeps only the next reservations: the message before is no longer in memory.
    pub fn clear(&self) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_shared_and_come_back() {
        let budget = ByteBudget::new(100, 60);
        let (a, b) = (Holder::Connection(1), Holder::Connection(2));
        let first = budget.reserve(&a, 50).unwrap();
        assert_eq!(budget.reserve(&a, 11).err(), Some(OverBudget::Share { bytes: 11, share: 60 }));
        let second = budget.reserve(&b, 50).unwrap();
        assert_eq!(budget.reserve(&a, 5).err(), Some(OverBudget::Total { bytes: 5, total: 100 }));
        drop(first);
        assert_eq!(budget.used(), 50);
        drop(budget.reserve(&a, 50).unwrap());
        drop(second);
        assert_eq!((budget.used(), budget.state().by_holder.len()), (0, 0));
    }

    #[test]
    fn who_does_not_read_its_replies_makes_room() {
        let budget = ByteBudget::new(10, 10);
        let (holder, close) = (Holder::Connection(1), CancellationToken::new());
        let _held = budget.reserve_closable(&holder, 10, &close).unwrap();
        assert!(budget.reserve(&Holder::Connection(2), 1).is_err() && !close.is_cancelled());
        let long_ago = Instant::now().checked_sub(2 * STALLED_AFTER).unwrap();
        budget.state().closable.values_mut().for_each(|entry| entry.0 = long_ago);
        assert!(budget.reserve(&Holder::Connection(2), 1).is_err() && close.is_cancelled());
    }
}
