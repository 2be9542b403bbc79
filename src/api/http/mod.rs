//! The HTTP port: health, metrics, dashboard, reports and trace files; a login for browsers.

mod login;
mod pages;
mod router;
pub mod serve_http;
mod visitor;
