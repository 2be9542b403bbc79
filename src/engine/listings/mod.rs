//! What is stored: listings of each kind of resource, and the overview of the dashboard.

mod overview;
mod resources;

pub use resources::{CreatedRange, ModelFilter, RevisionFilter, SetupRow, VideoFilter};
