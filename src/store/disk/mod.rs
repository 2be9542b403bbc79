//! The disk below the store: the database's file, an open database that survives failures, and the reserve of space.

pub(super) mod backend;
mod checked_pages;
pub(super) mod database;
pub(super) mod reserve;
