//! Traces: encoded on the pool, stored whole, listed, read, replayed, and removed by age or size.

pub mod backlog;
pub mod file;
pub mod replay;
pub mod retention;
pub mod stored;
pub mod upkeep;
