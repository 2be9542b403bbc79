//! The HTTP port: health, metrics, dashboard, reports and trace files.

mod pages;
pub mod router;
