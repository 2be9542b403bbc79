//! Where the camera stands: projection with derivatives, depth, and the camera of a view from straight above.

use crate::num::{Vec2, vec2};
use crate::scene::Camera;
use nalgebra::{Matrix3, Vector3};

/// A point in space (m).
pub(in crate::perception) type Point = [f64; 3];

/// A camera, prepared for many projections.
#[derive(Debug, Clone, Copy)]
pub(in crate::perception) struct Viewpoint {
    pub camera: Camera,
    /// The camera's centre (m); `None` for a parallel projection.
    centre: Option<Point>,
    /// From the scene to the camera, for a parallel projection.
    towards: Point,
}

impl Viewpoint {
    pub fn new(camera: Camera) -> Viewpoint {
        let rows = camera.matrix.map(|r| Vector3::new(r[0], r[1], r[2]));
        let left = Matrix3::from_rows(&rows.map(|r| r.transpose()));
        let last = Vector3::from(camera.matrix.map(|r| r[3]));
        let centre = left.try_inverse().map(|inverse| (-inverse * last).into());
        // Of a parallel projection both image rows are perpendicular to the line of sight; towards the camera is upwards.
        let cross = rows[0].cross(&rows[1]);
        let unit = if cross.norm() > 0.0 { cross / cross.norm() } else { Vector3::z() };
        let towards = if unit.z < 0.0 { -unit } else { unit };
        Viewpoint { camera, centre, towards: towards.into() }
    }

    /// From a point to the camera: the vector and whether its length is the distance.
    pub fn line_of_sight(&self, from: Point) -> (Point, bool) {
        match self.centre {
            Some(c) => ([c[0] - from[0], c[1] - from[1], c[2] - from[2]], true),
            None => (self.towards, false),
        }
    }

    /// Pixel of a point; `None` behind the camera.
    pub fn pixel(&self, p: Point) -> Option<[f64; 2]> {
        self.camera.project(vec2(p[0], p[1]), p[2])
    }

    /// Pixel of a point and the derivatives of the pixel by the point's coordinates (px/m).
    pub fn pixel_with_derivatives(&self, p: Point) -> Option<([f64; 2], [[f64; 3]; 2])> {
        let [a, b, c] = &self.camera.matrix;
        let w = c[0] * p[0] + c[1] * p[1] + c[2] * p[2] + c[3];
        let [u, v] = self.pixel(p)?;
        let by = |row: &[f64; 4], at: f64| [0, 1, 2].map(|k| (row[k] - at * c[k]) / w);
        Some(([u, v], [by(a, u), by(b, v)]))
    }

    /// Distance from the camera along its axis, up to a factor: of two bodies on the ground the one with less hides the other.
    pub fn depth(&self, at: Vec2) -> f64 {
        let c = &self.camera.matrix[2];
        c[0] * at.x + c[1] * at.y + c[3]
    }

    /// The ground position of a body whose centre at height `z` (m) is at this pixel.
    pub fn locate(&self, pixel: [f64; 2], z: f64) -> Option<Vec2> {
        self.camera.locate(pixel, z, [0.5; 2]).ok().map(|found| found.0)
    }

    /// Pixels per metre across the line of sight at a point.
    pub fn magnification(&self, p: Point) -> f64 {
        let Some((_, [du, dv])) = self.pixel_with_derivatives(p) else { return 0.0 };
        let square = |d: [f64; 3]| d.iter().map(|x| x * x).sum::<f64>();
        (0.5 * (square(du) + square(dv))).sqrt()
    }

    pub fn size(&self) -> [usize; 2] {
        self.camera.image_size.map(|s| s.max(0.0) as usize)
    }
}

/// The camera of a view from straight above with `scale` metres per pixel: x to the right, y up, the origin in the middle of the
/// image. It is a parallel projection: heights do not move a point.
pub fn top_camera(scale: f64, image_size: [f64; 2]) -> Camera {
    let [u, v] = [0.5 * image_size[0], 0.5 * image_size[1]];
    Camera {
        matrix: [[1.0 / scale, 0.0, 0.0, u], [0.0, -1.0 / scale, 0.0, v], [0.0, 0.0, 0.0, 1.0]],
        image_size,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::CLEVRER_CAMERA;

    #[test]
    fn derivatives_agree_with_differences_and_the_centre_with_the_matrix() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        let p = [0.7, -1.1, 0.3];
        let (_, d) = view.pixel_with_derivatives(p).unwrap();
        for k in 0..3 {
            let moved = |by: f64| {
                let mut q = p;
                q[k] += by;
                view.pixel(q).unwrap()
            };
            let (a, b) = (moved(1e-5), moved(-1e-5));
            for row in 0..2 {
                assert!((d[row][k] - (a[row] - b[row]) / 2e-5).abs() < 1e-4);
            }
        }
        // The camera looks along its third row; its centre projects nowhere.
        let (back, measured) = view.line_of_sight([0.0; 3]);
        assert!(measured && view.pixel(back).is_none());
    }

    #[test]
    fn from_above_the_scale_holds_at_every_height() {
        let view = Viewpoint::new(top_camera(0.01, [480.0, 320.0]));
        for z in [0.0, 0.3] {
            assert_eq!(view.pixel([1.0, 0.5, z]), Some([340.0, 110.0]));
            let at = view.locate([340.0, 110.0], z).unwrap();
            assert!((at - vec2(1.0, 0.5)).norm() < 1e-9);
        }
        assert!(!view.line_of_sight([0.0; 3]).1 && view.line_of_sight([0.0; 3]).0 == [0.0, 0.0, 1.0]);
    }
}
