//! Connections of both ports: accepted within limits, encrypted, and closed from outside.

pub mod accept;
pub mod connection;
pub mod seats;
pub mod tls;
