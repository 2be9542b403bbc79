//! The service over a real channel: what it does, keeps, shares, and refuses.

mod camera;
mod crowd;
mod discover;
mod disk;
mod endure;
mod flow;
mod garbage;
mod harness;
mod pages;
mod revise;
mod security;
mod setup;
mod sharing;
mod spans;
mod traces;
