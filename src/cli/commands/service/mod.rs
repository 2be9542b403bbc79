//! Commands that run the service or ask what it offers.

pub mod certs;
pub mod data;
pub mod effects;
pub mod health;
pub mod operations;
pub mod serve;
