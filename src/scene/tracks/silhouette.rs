//! The position of a body from the box around its image.
//!
//! The middle of the box is not the projected centre: perspective enlarges the near side of a body, and the image's border or
//! another body may hide a part. A body of known shape and size at position x (m) has a known box `b(x)` (4 edges, px). The
//! position is found by fixed-point steps `x <- locate(project(x) + move(e - b(x)))`, where e are the measured edges. Along an
//! image axis `move` is the mean difference of its two edges, or that of the only trusted edge. An edge is not trusted at the
//! image's border, nor where the box is too short and a nearer body covers it.
//!
//! Box of an ellipsoid with centre c (m), horizontal radius r and vertical half axis h: its dual quadric is
//! `Q* = c c^T - diag(r^2, r^2, h^2, 0)` (4x4, c homogeneous), the dual conic of its outline `C* = P Q* P^T` (3x3). The outline's
//! extremes along image axis k are the roots of `C*_33 t^2 - 2 C*_k3 t + C*_kk = 0`. A sphere has h = r, a disc h = 0.
//! A cylinder is the box of its two end discs, a box that of its eight corners, averaged over yaw as yaw is unknown.
//! Source: Hartley and Zisserman, Multiple View Geometry, 2nd ed., sections 8.3 and 8.6; the fixed point is ours.

use crate::num::{Vec2, elementary, vec2};
use crate::scene::camera::projection::{Camera, LocateError};
use crate::scene::covariance::Covariance;
use crate::scene::object::Shape;
use crate::scene::tracks::mask::BoundingBox;
use nalgebra::{Matrix3x4, Matrix4, Vector4};

/// An edge this near to the image's border may be cut by it (px).
const BORDER: f64 = 1.5;
/// Least missing length of a box with a hidden part, in standard deviations of its length.
const MIN_MISSING_DEVIATIONS: f64 = 4.0;
/// Least missing length of a box with a hidden part, as a share of its length.
const MIN_MISSING_SHARE: f64 = 0.12;
/// A hiding body reaches to within this distance of the edge that it causes (px).
const TOUCHING_DISTANCE: f64 = 3.0;
/// Fixed-point steps; each leaves about a tenth of the error.
const FIXED_POINT_STEPS: usize = 8;
/// Yaws over which the box of a square is averaged.
const YAWS: usize = 8;

/// Bird's-eye position of a body whose image has the box `measured`, with edges of standard deviation `sigma` (px), and its
/// covariance. `nearer`: boxes of bodies that may hide it.
pub fn place(
    camera: &Camera,
    shape: &Shape,
    measured: &BoundingBox,
    nearer: &[BoundingBox],
    sigma: f64,
) -> Result<(Vec2, Covariance), LocateError> {
    let z = shape.centre_height();
    let (mut position, _) = camera.locate(measured.centre(), z, [0.0; 2])?;
    let [width, height] = camera.image_size;
    let edges = measured.edges();
    let inside =
        [edges[0] > BORDER, edges[1] > BORDER, edges[2] < width - BORDER, edges[3] < height - BORDER];
    let mut result = camera.locate(measured.centre(), z, [sigma; 2])?;
    for _ in 0..FIXED_POINT_STEPS {
        let Some((expected, spread)) = outline(camera, shape, position, z) else { break };
        let Some(centre) = camera.project(position, z) else { break };
        let (mut target, mut deviation) = (centre, [0.0; 2]);
        for axis in 0..2 {
            let (low, high) = (axis, axis + 2);
            let missing = (expected[high] - expected[low]) - (edges[high] - edges[low]);
            let unsure = MIN_MISSING_DEVIATIONS * sigma + 2.0 * elementary::hypot(spread[low], spread[high]);
            let short = missing > unsure + MIN_MISSING_SHARE * (expected[high] - expected[low]);
            let hidden = |edge: usize| short && nearer.iter().any(|other| hides(other, measured, edge));
            let trusted = [low, high].map(|edge| inside[edge] && !hidden(edge));
            let difference = |edge: usize| edges[edge] - expected[edge];
            let (move_by, sd) = match trusted {
                [true, false] => (difference(low), elementary::hypot(sigma, spread[low])),
                [false, true] => (difference(high), elementary::hypot(sigma, spread[high])),
                // Either side may lack the missing part.
                _ if short => (
                    0.5 * (difference(low) + difference(high)),
                    elementary::hypot(0.7 * sigma, 0.5 * missing),
                ),
                _ => (0.5 * (difference(low) + difference(high)), sigma / std::f64::consts::SQRT_2),
            };
            target[axis] += move_by;
            deviation[axis] = sd;
        }
        result = camera.locate(target, z, deviation)?;
        let step = (result.0 - position).norm();
        position = result.0;
        if step < 1e-6 {
            break;
        }
    }
    Ok(result)
}

/// Whether `other` covers an edge of `measured` (0 left, 1 top, 2 right, 3 bottom), or ends there, but not its middle.
fn hides(other: &BoundingBox, measured: &BoundingBox, edge: usize) -> bool {
    let [u, v] = measured.centre();
    let [left, top, right, bottom] = measured.edges();
    let spans =
        |low: f64, high: f64, at: f64| (low - TOUCHING_DISTANCE..=high + TOUCHING_DISTANCE).contains(&at);
    let overlaps = |a: [f64; 2], b: [f64; 2]| a[0] < b[1] && b[0] < a[1];
    match edge {
        0 | 2 => {
            spans(other.left, other.right, if edge == 0 { left } else { right })
                && !spans(other.left, other.right, u)
                && overlaps([other.top, other.bottom], [top, bottom])
        }
        _ => {
            spans(other.top, other.bottom, if edge == 1 { top } else { bottom })
                && !spans(other.top, other.bottom, v)
                && overlaps([other.left, other.right], [left, right])
        }
    }
}

/// Left, top, right and bottom of the box around the image of a body at `at` with its centre at height `z` (m), in px, and the
/// standard deviation of each over an unknown yaw (px). `None` where the body reaches behind the camera.
pub fn outline(camera: &Camera, shape: &Shape, at: Vec2, z: f64) -> Option<([f64; 4], [f64; 4])> {
    let round = |height: f64, radius: f64, thick: f64| conic(camera, at, height, radius, thick);
    let joined = |a: [f64; 4], b: [f64; 4]| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])];
    match *shape {
        Shape::Ball { radius } => Some((round(z, radius, radius)?, [0.0; 4])),
        Shape::Disc { radius } => {
            Some((joined(round(0.0, radius, 0.0)?, round(2.0 * z, radius, 0.0)?), [0.0; 4]))
        }
        Shape::Square { .. } | Shape::Rectangle { .. } => {
            let [a, b] = shape.half_extents()?;
            let (mut sum, mut squares) = ([0.0; 4], [0.0; 4]);
            for k in 0..YAWS {
                let turn = Vec2::from_angle(std::f64::consts::PI * (k as f64 + 0.5) / YAWS as f64);
                let mut all = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
                for (x, y) in [(a, b), (a, -b), (-a, b), (-a, -b)] {
                    for height in [0.0, 2.0 * z] {
                        let [u, v] = camera.project(at + vec2(x, y).rotated(turn), height)?;
                        all = joined(all, [u, v, u, v]);
                    }
                }
                for (edge, value) in all.into_iter().enumerate() {
                    sum[edge] += value / YAWS as f64;
                    squares[edge] += value * value / YAWS as f64;
                }
            }
            let spread = [0, 1, 2, 3].map(|k| (squares[k] - sum[k] * sum[k]).max(0.0).sqrt());
            Some((sum, spread))
        }
    }
}

/// Box around the image of an ellipsoid with horizontal radius `radius` and vertical half axis `thick` (m).
fn conic(camera: &Camera, at: Vec2, z: f64, radius: f64, thick: f64) -> Option<[f64; 4]> {
    let centre = Vector4::new(at.x, at.y, z, 1.0);
    let (flat, tall) = (radius * radius, thick * thick);
    let dual = centre * centre.transpose() - Matrix4::from_diagonal(&Vector4::new(flat, flat, tall, 0.0));
    let camera = Matrix3x4::from_fn(|i, j| camera.matrix[i][j]);
    let c = camera * dual * camera.transpose();
    let extent = |k: usize| {
        let root = (c[(k, 2)] * c[(k, 2)] - c[(k, k)] * c[(2, 2)]).sqrt();
        (c[(2, 2)] > 0.0 && root.is_finite())
            .then(|| [(c[(k, 2)] - root) / c[(2, 2)], (c[(k, 2)] + root) / c[(2, 2)]])
    };
    let ([left, right], [top, bottom]) = (extent(0)?, extent(1)?);
    ((camera * centre).z > 0.0).then_some([left, top, right, bottom])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::CLEVRER_CAMERA;

    const SHAPES: [Shape; 3] =
        [Shape::Ball { radius: 0.2 }, Shape::Disc { radius: 0.2 }, Shape::Square { half_side: 0.2 }];

    fn seen(shape: &Shape, at: Vec2) -> BoundingBox {
        let ([left, top, right, bottom], _) = outline(&CLEVRER_CAMERA, shape, at, 0.2).unwrap();
        BoundingBox { left, top, right, bottom }
    }

    #[test]
    fn the_outline_encloses_points_on_the_surface() {
        let at = vec2(1.0, -0.7);
        let mut all = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for k in 0..400 {
            for l in 0..400 {
                let (a, b) =
                    (k as f64 * std::f64::consts::TAU / 400.0, l as f64 * std::f64::consts::PI / 399.0);
                let off = vec2(a.cos(), a.sin()).scaled(0.2 * b.sin());
                let [u, v] = CLEVRER_CAMERA.project(at + off, 0.2 + 0.2 * b.cos()).unwrap();
                all = [all[0].min(u), all[1].min(v), all[2].max(u), all[3].max(v)];
            }
        }
        let (found, _) = outline(&CLEVRER_CAMERA, &SHAPES[0], at, 0.2).unwrap();
        assert!(found.iter().zip(all).all(|(a, b)| (a - b).abs() < 0.02), "{found:?} {all:?}");
    }

    #[test]
    fn a_body_is_located_from_its_box_also_when_cut_or_hidden() {
        for shape in SHAPES {
            let at = vec2(0.5, 1.0);
            let whole = seen(&shape, at);
            let error = |b: &BoundingBox, nearer: &[BoundingBox]| {
                (place(&CLEVRER_CAMERA, &shape, b, nearer, 0.5).unwrap().0 - at).norm()
            };
            assert!(error(&whole, &[]) < 1e-4, "{shape:?}");
            // The middle of the box alone would have an error; that of a ball is small.
            let (middle, _) = CLEVRER_CAMERA.locate(whole.centre(), 0.2, [0.5; 2]).unwrap();
            assert!(shape.is_ball() || (middle - at).norm() > 0.002, "{shape:?}");
            let half = BoundingBox { right: whole.centre()[0], ..whole };
            let nearer = BoundingBox { left: half.right - 1.0, right: half.right + 40.0, ..whole };
            assert!(error(&half, &[nearer]) < 1e-3, "{shape:?} hidden");
            assert!(error(&half, &[]) > 0.05, "without a hiding body the missing side is unknown");
        }
        // Cut by the left border of the image.
        let shape = SHAPES[0];
        let at = (0..400)
            .map(|k| vec2(0.0, -1.0 - 0.01 * k as f64))
            .find(|&at| seen(&shape, at).left < -12.0)
            .unwrap();
        let cut = BoundingBox { left: 0.0, ..seen(&shape, at) };
        let (found, _) = place(&CLEVRER_CAMERA, &shape, &cut, &[], 0.5).unwrap();
        assert!((found - at).norm() < 1e-3);
    }
}
