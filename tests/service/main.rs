//! The service over a real channel: what it does, keeps, shares, and refuses.

mod discover;
mod flow;
mod garbage;
mod harness;
mod setup;
mod sharing;
mod traces;
