//! The gRPC edge: the generated messages, their conversion, the services and their server.

mod accept;
mod calls;
mod camera;
mod guard;
pub mod http;
mod metrics;
mod pages;
mod reply;
mod report;
mod request;
mod server;
mod services;
mod status;
mod study;
mod trace;
pub mod video;

pub(crate) use camera::camera_message;
pub use guard::{Security, TokenError, Tokens};
pub use server::{Limits, ServeError, serve};

/// Messages, clients and servers of package `vrdp.v1`, generated from `proto/`.
#[allow(clippy::all, missing_docs)]
pub mod v1 {
    tonic::include_proto!("vrdp.v1");
}

/// Descriptors of all of `proto/`, for reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
