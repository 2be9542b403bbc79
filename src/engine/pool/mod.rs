//! The CPU pool: a fixed number of workers behind a bounded queue that is fair between tenants.
//!
//! Invariants:
//! * At most `workers` jobs run at a time, and at most `workers + queue` are admitted; one more is refused at once.
//!   Where several tenants share the service, none may hold more than its share of these slots (`admission`).
//! * Between tenants, CPU time is shared equally (`fair_queue`). Jobs of one tenant and class start in order of arrival.
//! * Work of minutes never takes all workers, and gives way to work of milliseconds (`class`, `scheduler`).
//! * A job runs on threads of its own (`job_threads`): a thread that waits for a part of its sum finds only parts of the
//!   same job, never another job.
//! * A job holds its [`QueueSlot`] until its caller has stored the result: while the disk is slow, fewer jobs start.
//! * A job that panics fails alone, with an id that the log has too.
//! * A caller gets its error as soon as its token is cancelled or its deadline passes. A job that waits then leaves the
//!   queue. One that runs ends at its next check of [`JobContext::check`], and keeps its slot until then.

mod admission;
mod class;
mod context;
mod fair_queue;
mod job_threads;
mod run;
mod scheduler;
#[cfg(test)]
mod tests;

pub use admission::{Admission, QueueSlot};
pub use class::JobKind;
pub use context::JobContext;
pub use run::{Pool, panic_message};
pub use scheduler::Load;
