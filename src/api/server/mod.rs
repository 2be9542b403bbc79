//! The gRPC server: connections, encryption, authentication, limits, request ids and metrics around the services.

pub mod auth;
pub mod byte_budget;
mod call;
pub mod connections;
pub mod metrics;
pub mod port_context;
mod process_metrics;
pub mod readiness;
pub mod reply_body;
pub mod request_body;
pub mod request_layer;
pub mod serve;
pub mod services;
pub mod sessions;
