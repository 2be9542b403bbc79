//! The gRPC server: connections, authentication, request ids and metrics around the services.

mod accept;
pub mod auth;
pub mod metrics;
mod request_layer;
pub mod serve;
mod services;
