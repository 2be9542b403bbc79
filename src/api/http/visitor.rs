//! Who asks at the HTTP port.

use crate::api::server::byte_budget::Holder;
use crate::api::server::port_context::PortContext;
use crate::engine::{Engine, Tenant};
use std::sync::Arc;

/// Who asks, and for what part of the service.
#[derive(Clone)]
pub struct Visitor {
    pub engine: Arc<Engine>,
    pub context: PortContext,
    /// Where tokens are needed and the visitor has one.
    pub tenant: Option<Tenant>,
    pub holder: Holder,
    /// Whether the connection is encrypted.
    pub is_encrypted: bool,
}
