//! What was seen, what was not, and how sure it is.

use super::appearance::AppearanceFeatures;
use serde::Serialize;

/// Report of one video.
#[derive(Debug, Clone, Serialize)]
pub struct PerceptionReport {
    pub format: String,
    pub image_size: [usize; 2],
    pub frames: usize,
    pub fps: f64,
    pub objects: Vec<PerceivedObject>,
    /// Object-frames in which the silhouette touches another one, and in which less than 90 % of it is visible.
    pub merged: usize,
    pub hidden: usize,
    /// Connected pixels that are no body: hands, cues, captions, reflections. The largest of each frame run.
    pub unexplained: Vec<UnexplainedRegion>,
    pub warnings: Vec<String>,
}

#[derive(Debug, Clone, Serialize)]
pub struct PerceivedObject {
    pub id: u32,
    pub shape: String,
    pub color: String,
    pub material: String,
    pub shape_probability: f64,
    pub color_probability: f64,
    pub material_probability: f64,
    pub first_frame: usize,
    pub last_frame: usize,
    pub frames_placed: usize,
    /// Median distance of the image's edges from the outline (px).
    pub outline_residual: f64,
    pub form_costs: [f64; 3],
    pub appearance: AppearanceFeatures,
}

/// Pixels that show neither the ground nor a tracked body, over consecutive frames.
#[derive(Debug, Clone, Serialize)]
pub struct UnexplainedRegion {
    pub first_frame: usize,
    pub last_frame: usize,
    /// Left, top, right, bottom (px) where it is largest.
    pub bounds: [usize; 4],
    pub pixels: usize,
}

/// Joins components of neighbouring frames whose boxes overlap.
pub(super) fn joined(components: &[(usize, [usize; 4], usize)]) -> Vec<UnexplainedRegion> {
    let mut regions: Vec<(UnexplainedRegion, [usize; 4])> = vec![];
    for &(frame, bounds, pixels) in components {
        let overlaps =
            |b: &[usize; 4]| b[0] < bounds[2] && bounds[0] < b[2] && b[1] < bounds[3] && bounds[1] < b[3];
        match regions.iter_mut().rev().find(|(r, last)| r.last_frame + 3 >= frame && overlaps(last)) {
            Some((region, last)) => {
                (region.last_frame, *last) = (frame, bounds);
                if pixels > region.pixels {
                    (region.bounds, region.pixels) = (bounds, pixels);
                }
            }
            None => regions
                .push((UnexplainedRegion { first_frame: frame, last_frame: frame, bounds, pixels }, bounds)),
        }
    }
    regions.into_iter().map(|r| r.0).collect()
}
