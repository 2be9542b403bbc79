//! Places for the connections of one port: a fixed number, so that files are left for the data folder.
//!
//! Where all are taken, a new connection takes the place of the one that has been idle longest; those that never made a call go
//! first. Where all have running calls, the new one is closed at once.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio_util::sync::CancellationToken;

/// The places of one port.
pub struct Seats {
    places: Arc<Semaphore>,
    taken: Mutex<BTreeMap<u64, Arc<Seat>>>,
    start: Instant,
}

/// The number of the last connection of the process, on any port.
static LAST: AtomicU64 = AtomicU64::new(0);

/// What is known of one connection.
pub struct Seat {
    pub id: u64,
    /// Closes the connection.
    pub close: CancellationToken,
    running: AtomicUsize,
    has_called: AtomicBool,
    /// When its last call ended, or it was accepted (ns after the start of the port).
    idle_since: AtomicU64,
    start: Instant,
}

/// The place of one connection, until it is dropped.
pub struct TakenSeat {
    pub seat: Arc<Seat>,
    seats: Arc<Seats>,
    _place: OwnedSemaphorePermit,
}

/// A running call; its connection is not closed for another one meanwhile.
pub struct RunningCall(Arc<Seat>);

impl Seats {
    /// So many places.
    pub fn new(most: usize) -> Arc<Seats> {
        Arc::new(Seats {
            places: Arc::new(Semaphore::new(most.max(1))),
            taken: Mutex::default(),
            start: Instant::now(),
        })
    }

    /// No code panics while it holds this lock.
    fn taken(&self) -> MutexGuard<'_, BTreeMap<u64, Arc<Seat>>> {
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A place for a new connection; `None` where all have running calls.
    pub async fn take(self: &Arc<Self>) -> Option<TakenSeat> {
        let place = match self.places.clone().try_acquire_owned() {
            Ok(place) => place,
            Err(_) => {
                self.close_idlest().then_some(())?;
                // Its task ends and returns the place.
                self.places.clone().acquire_owned().await.ok()?
            }
        };
        let id = LAST.fetch_add(1, Ordering::Relaxed);
        let seat = Arc::new(Seat {
            id,
            close: CancellationToken::new(),
            running: AtomicUsize::new(0),
            has_called: AtomicBool::new(false),
            idle_since: AtomicU64::new(nanoseconds(self.start)),
            start: self.start,
        });
        self.taken().insert(id, seat.clone());
        Some(TakenSeat { seat, seats: self.clone(), _place: place })
    }

    fn close_idlest(&self) -> bool {
        let mut taken = self.taken();
        let idle = taken.values().filter(|seat| seat.running.load(Ordering::Relaxed) == 0);
        let rank = |seat: &&Arc<Seat>| {
            (seat.has_called.load(Ordering::Relaxed), seat.idle_since.load(Ordering::Relaxed))
        };
        let Some(idlest) = idle.min_by_key(rank).cloned() else { return false };
        taken.remove(&idlest.id);
        idlest.close.cancel();
        true
    }
}

fn nanoseconds(start: Instant) -> u64 {
    u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX)
}

impl Seat {
    /// Marks a call as running until the result is dropped.
    pub fn call(self: &Arc<Self>) -> RunningCall {
        self.has_called.store(true, Ordering::Relaxed);
        self.running.fetch_add(1, Ordering::Relaxed);
        RunningCall(self.clone())
    }
}

impl Drop for RunningCall {
    fn drop(&mut self) {
        self.0.idle_since.store(nanoseconds(self.0.start), Ordering::Relaxed);
        self.0.running.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Drop for TakenSeat {
    fn drop(&mut self) {
        self.seats.taken().remove(&self.seat.id);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_idlest_connection_makes_room_and_a_busy_one_does_not() {
        let seats = Seats::new(2);
        let (first, second) = (seats.take().await.unwrap(), seats.take().await.unwrap());
        drop(first.seat.call());
        let busy = first.seat.call();
        // The second has never called; it goes, and its task returns the place.
        let closed = second.seat.close.clone();
        let task = tokio::spawn(async move {
            second.seat.close.cancelled().await;
            drop(second);
        });
        let third = seats.take().await.unwrap();
        task.await.unwrap();
        assert!(closed.is_cancelled() && !first.seat.close.is_cancelled());
        let _busy_too = third.seat.call();
        assert!(seats.take().await.is_none());
        drop((busy, first));
        assert!(seats.take().await.is_some());
    }
}
