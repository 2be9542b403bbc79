//! The gRPC and HTTP interface: generated messages, their conversion, the services and their servers.

mod convert;
mod http;
mod server;
mod status;

pub use self::http::serve_http::serve_http;
pub(crate) use convert::ingest::camera::camera_message;
pub(crate) use convert::ingest::detections::linking_message;
pub use convert::ingest::new_video::new_video;
pub(crate) use convert::ingest::stills::still_message;
pub use convert::video::{scene_from_message, video_message};
pub use server::auth::{LiveSecurity, Security, TokenError, Tokens};
pub use server::connections::tls::{Tls, TlsError};
pub use server::port_context::{PortContext, PortLimits};
pub use server::readiness::ReadinessLimits;
pub use server::serve::{ServeError, ServerLimits, serve};
pub use server::services::resume_operations;

/// Messages, clients and servers of package `vrdp.v1`, generated from `proto/`.
#[allow(clippy::all, missing_docs)]
pub mod v1 {
    tonic::include_proto!("vrdp.v1");
}

/// Descriptors of all of `proto/`, for reflection.
pub const DESCRIPTORS: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/descriptors.bin"));
