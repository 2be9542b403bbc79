//! Pixels: light, the empty ground, what departs from it, and which pixels look like a body.

pub(in crate::perception) mod colour_histogram;
pub(in crate::perception) mod evidence;
pub(in crate::perception) mod ground;
pub(in crate::perception) mod light;
