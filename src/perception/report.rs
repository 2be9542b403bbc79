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
    /// Median share of the outline that has a fitting edge.
    pub outline_support: f64,
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

/// Joins components of neighbouring frames whose boxes overlap, each with the most alike box.
pub(super) fn joined(components: &[(usize, [usize; 4], usize)]) -> Vec<UnexplainedRegion> {
    let mut regions: Vec<(UnexplainedRegion, [usize; 4])> = vec![];
    // Regions that later components may join.
    let mut open: Vec<usize> = vec![];
    for &(frame, bounds, pixels) in components {
        open.retain(|&k| regions[k].0.last_frame + 3 >= frame);
        let alike = |&k: &usize| (k, overlap(&regions[k].1, &bounds));
        // The last of equal ones is the newest.
        let best = open.iter().map(alike).filter(|b| b.1 > LEAST_OVERLAP).max_by(|a, b| a.1.total_cmp(&b.1));
        match best {
            Some((k, _)) => {
                let (region, last) = &mut regions[k];
                (region.last_frame, *last) = (frame, bounds);
                if pixels > region.pixels {
                    (region.bounds, region.pixels) = (bounds, pixels);
                }
            }
            None => {
                open.push(regions.len());
                let region = UnexplainedRegion { first_frame: frame, last_frame: frame, bounds, pixels };
                regions.push((region, bounds));
            }
        }
    }
    let mut regions: Vec<UnexplainedRegion> = regions.into_iter().map(|r| r.0).collect();
    let weight = |r: &UnexplainedRegion| r.pixels * (r.last_frame + 1 - r.first_frame);
    regions.sort_by_key(|r| std::cmp::Reverse(weight(r)));
    regions.truncate(MAX_REGIONS);
    regions.sort_by_key(|r| r.first_frame);
    regions
}

/// Most regions that are reported: the largest over the longest time.
const MAX_REGIONS: usize = 100;

/// Least overlap of two boxes that show the same thing: a small one may move by half its width.
const LEAST_OVERLAP: f64 = 0.2;

/// Area that two boxes share as a share of that which either covers.
fn overlap(a: &[usize; 4], b: &[usize; 4]) -> f64 {
    let side = |k: usize| a[k + 2].min(b[k + 2]).saturating_sub(a[k].max(b[k])) as f64;
    let area = |b: &[usize; 4]| (b[2].saturating_sub(b[0]) * b[3].saturating_sub(b[1])) as f64;
    let common = side(0) * side(1);
    common / (area(a) + area(b) - common).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_within_the_box_of_the_table_is_a_region_of_its_own() {
        let frames = (0..10)
            .flat_map(|k| [(k, [0, 0, 640, 360], 80_000), (k, [300, 10 + 4 * k, 340, 80 + 4 * k], 1000 + k)]);
        let regions = joined(&frames.collect::<Vec<_>>());
        let seen: Vec<_> = regions.iter().map(|r| (r.first_frame, r.last_frame, r.pixels)).collect();
        assert_eq!(seen, [(0, 9, 80_000), (0, 9, 1009)]);
    }
}
