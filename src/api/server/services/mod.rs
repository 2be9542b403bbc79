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

use crate::engine::{Engine, Tenant};
use futures_util::stream::BoxStream;
use std::sync::Arc;
use tonic::{Request, Response, Status};

type RpcResult<T> = Result<Response<T>, Status>;
type RpcStream<T> = BoxStream<'static, Result<T, Status>>;

/// All services over one engine.
#[derive(Clone)]
pub struct Services(pub Arc<Engine>);

impl Services {
    /// The engine as the caller's tenant sees it; the authentication layer has set the tenant.
    fn owner<T>(&self, request: &Request<T>) -> Arc<Engine> {
        match request.extensions().get::<Tenant>() {
            Some(tenant) => self.0.of(tenant),
            None => self.0.clone(),
        }
    }
}

/// Cuts the rows to a page and returns the token of the next page; it is empty on the last page.
fn cut_page<T>(rows: &mut Vec<T>, size: usize, id: impl Fn(&T) -> &String) -> String {
    if rows.len() <= size {
        return String::new();
    }
    rows.truncate(size);
    rows.last().map(|row| id(row).clone()).unwrap_or_default()
}
