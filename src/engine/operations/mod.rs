//! Operations: long work that goes on when its caller leaves, and whose result is kept for a while.
//!
//! Invariants:
//! * A record and its request are durable before its name is returned, and the end of an operation before anyone sees it.
//! * An operation is in [`running`] from before its record is stored until after its end is. What a service's end cuts short goes on in
//!   the next one: it is there before the first call is served. A record that says it runs, of an operation that is not there, is one
//!   that is not started again.
//! * A deleted operation does not come back: its end is stored only where its record still is.

mod record;
mod run;
mod running;

pub use record::{OperationFilter, OperationKind, OperationRecord, OperationState};
pub use run::{CutOperation, NewOperation, OperationOutcome, OperationStatus, OperationUpdate};
pub use running::RunningOperations;
