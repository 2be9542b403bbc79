//! Commands that read and write files of cameras, tracks and traces.

pub mod calibrate;
pub mod convert;
pub mod import;
pub mod replay;
pub mod trace;
