//! The way to the service: options, the service inside this process, a remote one, and streamed replies.

mod client;
mod local;
mod remote;
pub mod stream;
mod target;

pub use client::Connection;
pub use local::start;
pub use remote::remote;
pub use target::Target;
