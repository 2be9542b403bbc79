//! Care for a data folder: copies of it while it is used, what is damaged in it, and a folder made of a copy.

pub(super) mod archive;
pub(super) mod backup;
pub(super) mod check;
pub(super) mod restore;
