//! What a scene may hold: counts, ranges and the size taken where none is given.

/// Most objects in one scene: contacts are searched pair by pair and a posterior covers all objects.
pub const MAX_OBJECTS: usize = 128;
/// Most frames in one scene: ten minutes at 25 frames/s.
pub const MAX_FRAMES: usize = 15_000;
/// Longest name of a scene or a set-up (bytes): it becomes part of keys and file names.
pub const MAX_NAME: usize = 200;
/// Most features of an object or a detection: four times the 256 that region features of detectors have.
pub const MAX_FEATURES: usize = 1024;
/// Largest coordinate (m); beyond it the resolution of positions suffers.
pub const MAX_POSITION: f64 = 1e6;
/// Radius or half side taken where a scene gives none (m): that of CLEVRER's objects.
pub const DEFAULT_SIZE: f64 = 0.2;
/// Radii and half sides (m).
pub const SIZE_RANGE: [f64; 2] = [1e-6, 1e3];
/// Masses (kg).
pub const MASS_RANGE: [f64; 2] = [1e-9, 1e9];
/// Frame rate taken where a file gives none (1/s): that of CLEVRER's videos.
pub(super) const DEFAULT_FPS: f64 = 25.0;
/// Frame rates that cameras have (1/s).
pub(super) const FPS_RANGE: [f64; 2] = [0.1, 1e5];
/// Standard deviation of a measured position (m).
pub(super) const NOISE_RANGE: [f64; 2] = [1e-9, 1e3];
