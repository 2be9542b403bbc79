//! The services: each call is converted, handed to the engine, and its result converted back.

mod calls;
mod comparison;
mod concepts;
mod import;
mod models;
mod operations;
mod reasoning;
mod report;
mod statistics;
mod traces;
mod updates;
mod videos;

pub use operations::resume_operations;

use super::byte_budget::{ByteBudget, HeldBytes};
use crate::engine::{Engine, Tenant};
use futures_util::stream::BoxStream;
use std::sync::Arc;
use tonic::{Request, Response, Status};

type RpcResult<T> = Result<Response<T>, Status>;
type RpcStream<T> = BoxStream<'static, Result<T, Status>>;

/// All services over one engine.
#[derive(Clone)]
pub struct Services {
    pub engine: Arc<Engine>,
    /// Bytes of files of videos in flight.
    pub imports: ByteBudget,
}

impl Services {
    /// The engine as the caller's tenant sees it; the authentication layer has set the tenant.
    fn owner<T>(&self, request: &Request<T>) -> Arc<Engine> {
        match request.extensions().get::<Tenant>() {
            Some(tenant) => self.engine.of(tenant),
            None => self.engine.clone(),
        }
    }
}

/// The reservation of the bytes of a call; work that holds them holds it too.
fn held<T>(request: &Request<T>) -> HeldBytes {
    request.extensions().get::<HeldBytes>().cloned().unwrap_or_default()
}

/// Cuts the rows to a page and returns the token of the next page; it is empty on the last page.
fn cut_page<T>(rows: &mut Vec<T>, size: usize, id: impl Fn(&T) -> &String) -> String {
    if rows.len() <= size {
        return String::new();
    }
    rows.truncate(size);
    rows.last().map(|row| id(row).clone()).unwrap_or_default()
}
