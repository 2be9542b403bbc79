//! The way to the service: options, the service inside this process, a remote one, and streamed replies.

mod client;
mod data_folder;
mod data_socket;
mod kept;
mod local;
mod remote;
pub mod stream;
mod target;

pub use client::Connection;
pub use data_folder::Announcement;
pub use data_socket::{backup_from_service, check_by_service};
pub use kept::{heads, id, the_one};
pub use local::start;
pub use remote::remote;
pub use target::Target;
