//! Outlines of bodies in the image: projection, who hides whom, and the fits to pixels and to edges.

pub(in crate::perception) mod contour_fit;
pub(in crate::perception) mod depth_order;
pub(in crate::perception) mod frame_fit;
pub(in crate::perception) mod outline;
pub(in crate::perception) mod region_search;
pub(in crate::perception) mod viewpoint;
