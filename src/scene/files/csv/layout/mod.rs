//! Tables whose columns need a rule before they are read: boxes, no header, three coordinates, lines that are no rows.

pub(super) mod boxes;
pub(super) mod headerless;
pub(super) mod planes;
pub(super) mod tail;
