//! The outline of a body in the image.
//!
//! The outline of a convex body is the convex hull of the image of some of its points: the 8 corners of a cube, the two rims of a
//! cylinder, the circle on a ball where lines of sight touch it. Let F be the foot of the body (x, y, 0), X the body's point that
//! an outline point u shows, and n the outline's outer normal (unit vector, px). If the pose changes, the outline moves along n by
//!
//! `n . (du/dX) dX`, with `dX = (dx, dy, 0)` for a shift, `z x (X - F) d yaw` for a turn, `(X - F) d size / size` for growth.
//!
//! X itself slides over the body, but only along the line of sight or the outline (the envelope theorem), which changes
//! nothing along n. Source: Cipolla and Giblin, Visual Motion of Curves and Surfaces (2000), chapter 2.

use crate::num::{Vec2, elementary};
use crate::perception::outlines::viewpoint::{Point, Viewpoint};
use crate::scene::{Camera, Shape};

/// Points on a rim. The polygon lies inside the circle by at most `1 - cos(pi/48) = 0.2 %` of the radius: 0.04 px of 20.
const RIM_POINTS: usize = 48;
/// Radius of the rounding of edges as a share of the body's size, and the chamfer that cuts as much off an edge seen at 30 to 45
/// degrees: a rounding of radius r cuts r (cos a + sin a - 1), a chamfer of leg c cuts c sin a, so that c = 0.65 r.
const CHAMFER: f64 = 0.65 * 0.04;

/// Least sine of the angle between a line of sight and a face that shows: less is a line of one pixel.
const LEAST_SLANT: f64 = 0.05;

/// BodyForm of a body that stands on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum BodyForm {
    Ball,
    Cylinder,
    Cube,
}

pub(in crate::perception) const FORMS: [BodyForm; 3] = [BodyForm::Ball, BodyForm::Cylinder, BodyForm::Cube];

/// A body of one form and size at one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    pub form: BodyForm,
    /// Radius or half side, and half the height (m).
    pub size: f64,
    /// Ground position (m).
    pub at: Vec2,
    /// rad; without meaning for a ball or a cylinder.
    pub yaw: f64,
}

/// A point of the outline.
#[derive(Debug, Clone, Copy)]
pub(in crate::perception) struct OutlinePoint {
    pub pixel: [f64; 2],
    /// Outer normal, of length 1.
    pub normal: [f64; 2],
    /// What moves it along the normal (px per m, m, rad, m): x, y, yaw, size.
    pub motion: [f64; 4],
    /// Whether it lies inside the silhouette, where two visible faces of a cube meet.
    pub is_crease: bool,
}

/// A corner of the hull: its pixel and the body's point there.
type Corner = ([f64; 2], Point);

/// The convex outline of a body, counter-clockwise as seen with v up.
#[derive(Debug, Clone)]
pub(in crate::perception) struct Outline {
    pose: Pose,
    corners: Vec<Corner>,
}

/// The columns that a convex region covers in each row of the image.
#[derive(Debug, Clone, Default, PartialEq)]
pub(in crate::perception) struct Spans {
    pub top: i32,
    /// First column and the one after the last, row by row.
    pub rows: Vec<[i32; 2]>,
}

impl Outline {
    /// `None` where the body reaches behind the camera.
    pub fn new(view: &Viewpoint, pose: &Pose) -> Option<Outline> {
        let points = surface_points(view, pose);
        let corners: Option<Vec<Corner>> = points.into_iter().map(|p| Some((view.pixel(p)?, p))).collect();
        let corners = match pose.form {
            BodyForm::Ball => corners?,
            _ => hull(corners?),
        };
        (corners.len() > 2).then_some(Outline { pose: *pose, corners })
    }

    /// Length of the polygon (px).
    pub fn length(&self) -> f64 {
        let next = self.corners.iter().cycle().skip(1);
        let side = |((a, _), (b, _)): (&Corner, &Corner)| elementary::hypot(b[0] - a[0], b[1] - a[1]);
        self.corners.iter().zip(next).map(side).sum()
    }

    /// Points of the outline `step` px apart, away from its sharp corners by half a step.
    pub fn points(&self, view: &Viewpoint, step: f64) -> Vec<OutlinePoint> {
        let mut points = vec![];
        let mut left_over = 0.5 * step;
        for (k, &(a, pa)) in self.corners.iter().enumerate() {
            let (b, pb) = self.corners[(k + 1) % self.corners.len()];
            let (du, dv) = (b[0] - a[0], b[1] - a[1]);
            let length = (du * du + dv * dv).sqrt();
            if length < 1e-9 {
                continue;
            }
            let normal = [dv / length, -du / length];
            while left_over < length {
                let t = left_over / length;
                let x = [0, 1, 2].map(|i| pa[i] + t * (pb[i] - pa[i]));
                if let Some(point) = self.outline_point(view, x, normal) {
                    points.push(point);
                }
                left_over += step;
            }
            left_over -= length;
        }
        points
    }

    fn outline_point(&self, view: &Viewpoint, x: Point, normal: [f64; 2]) -> Option<OutlinePoint> {
        let (pixel, d) = view.pixel_with_derivatives(x)?;
        let by = |dx: Point| {
            let move_of = |row: &[f64; 3]| row[0] * dx[0] + row[1] * dx[1] + row[2] * dx[2];
            normal[0] * move_of(&d[0]) + normal[1] * move_of(&d[1])
        };
        let (fx, fy) = (x[0] - self.pose.at.x, x[1] - self.pose.at.y);
        let turn = if self.pose.form == BodyForm::Cube { by([-fy, fx, 0.0]) } else { 0.0 };
        let size = self.pose.size;
        let growth = by([fx / size, fy / size, x[2] / size]);
        let motion = [by([1.0, 0.0, 0.0]), by([0.0, 1.0, 0.0]), turn, growth];
        Some(OutlinePoint { pixel, normal, motion, is_crease: false })
    }

    /// Points of the edges inside the silhouette, where two visible faces of a cube meet. Where a face mirrors the ground, these
    /// are seen and the outline is not.
    pub fn creases(&self, view: &Viewpoint, step: f64) -> Vec<OutlinePoint> {
        if self.pose.form != BodyForm::Cube {
            return vec![];
        }
        let Pose { size, at, yaw, .. } = self.pose;
        let (s, c) = elementary::sin_cos(yaw);
        let edge = size * (1.0 - 0.5 * CHAMFER);
        let place = |[x, y, z]: Point| {
            [at.x + edge * (c * x - s * y), at.y + edge * (s * x + c * y), size + edge * z]
        };
        // Side faces that the camera sees; the top always is.
        let sides = [[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]];
        let seen: Vec<[f64; 2]> = sides
            .into_iter()
            .filter(|[x, y]| {
                let (to, _) = view.line_of_sight(place([*x, *y, 0.0]));
                let normal = [c * x - s * y, s * x + c * y];
                let length = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
                to[0] * normal[0] + to[1] * normal[1] > LEAST_SLANT * length
            })
            .collect();
        let mut ends: Vec<[Point; 2]> =
            seen.iter().map(|[x, y]| [[x + y, y - x, 1.0], [x - y, y + x, 1.0]]).collect();
        if let [[ax, ay], [bx, by]] = seen[..] {
            ends.push([[ax + bx, ay + by, 1.0], [ax + bx, ay + by, -1.0]]);
        }
        ends.into_iter().flat_map(|[a, b]| self.crease(view, (place(a), place(b)), step)).collect()
    }

    /// Points of one edge `step` px apart, away from its ends.
    fn crease(&self, view: &Viewpoint, (a, b): (Point, Point), step: f64) -> Vec<OutlinePoint> {
        let Some((from, to)) = view.pixel(a).zip(view.pixel(b)) else { return vec![] };
        let (du, dv) = (to[0] - from[0], to[1] - from[1]);
        let length = elementary::hypot(du, dv);
        let count = (length / step) as usize;
        // The ends are corners of the outline.
        (1..count.saturating_sub(1))
            .filter_map(|k| {
                let share = (k as f64 + 0.5) / count as f64;
                let x = [0, 1, 2].map(|i| a[i] + share * (b[i] - a[i]));
                let point = self.outline_point(view, x, [dv / length, -du / length])?;
                Some(OutlinePoint { is_crease: true, ..point })
            })
            .collect()
    }

    /// The pixels whose centres lie inside; not cut by the image.
    pub fn spans(&self) -> Spans {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for (p, _) in &self.corners {
            (low, high) = (low.min(p[1]), high.max(p[1]));
        }
        // Bodies far outside the image are of no interest; the bound keeps the rows few.
        let (low, high) = (low.clamp(-1e4, 1e4), high.clamp(-1e4, 1e4));
        let top = (low - 0.5).ceil() as i32;
        let count = ((high - 0.5).ceil() as i32 - top).max(0) as usize;
        let mut edges = vec![[f64::INFINITY, f64::NEG_INFINITY]; count];
        for (k, (a, _)) in self.corners.iter().enumerate() {
            let (b, _) = &self.corners[(k + 1) % self.corners.len()];
            let (up, down) = if a[1] < b[1] { (a, b) } else { (b, a) };
            let first = ((up[1] - 0.5).ceil() as i32 - top).max(0) as usize;
            let last = (((down[1] - 0.5).ceil() as i32 - top).max(0) as usize).min(count);
            let slope = (down[0] - up[0]) / (down[1] - up[1]);
            for (row, edge) in edges.iter_mut().enumerate().take(last).skip(first) {
                let u = up[0] + slope * ((top + row as i32) as f64 + 0.5 - up[1]);
                *edge = [edge[0].min(u), edge[1].max(u)];
            }
        }
        let column = |u: f64| (u.clamp(-1e4, 1e4) - 0.5).ceil() as i32;
        let rows = edges.into_iter().map(|[l, r]| if l < r { [column(l), column(r)] } else { [0, 0] });
        Spans { top, rows: rows.collect() }
    }
}

/// The outline of an object in the image: the corners of a polygon (px). A box is as high as it is wide. `None` where it reaches
/// behind the camera.
pub fn outline_of(camera: &Camera, shape: &Shape, at: Vec2, yaw: f64) -> Option<Vec<[f64; 2]>> {
    let view = Viewpoint::new(*camera);
    let (form, size) = match *shape {
        Shape::Ball { radius } => (BodyForm::Ball, radius),
        Shape::Disc { radius } => (BodyForm::Cylinder, radius),
        Shape::Square { half_side } => (BodyForm::Cube, half_side),
        Shape::Rectangle { half_length, half_width } => {
            return box_outline(&view, [half_length, half_width], at, yaw);
        }
    };
    let outline = Outline::new(&view, &Pose { form, size, at, yaw })?;
    Some(outline.corners.iter().map(|(pixel, _)| *pixel).collect())
}

fn box_outline(view: &Viewpoint, [length, width]: [f64; 2], at: Vec2, yaw: f64) -> Option<Vec<[f64; 2]>> {
    let (s, c) = elementary::sin_cos(yaw);
    let corner = |k: usize| {
        let sign = |bit: usize| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
        let (x, y) = (sign(0) * length, sign(1) * width);
        let point = [at.x + c * x - s * y, at.y + s * x + c * y, width * (1.0 + sign(2))];
        Some((view.pixel(point)?, point))
    };
    let corners: Option<Vec<Corner>> = (0..8).map(corner).collect();
    Some(hull(corners?).into_iter().map(|(pixel, _)| pixel).collect())
}

/// Points of the body's surface whose hull in the image is its outline.
fn surface_points(view: &Viewpoint, pose: &Pose) -> Vec<Point> {
    let Pose { form, size, at, yaw } = *pose;
    let angle = |k: usize| std::f64::consts::TAU * k as f64 / RIM_POINTS as f64;
    match form {
        BodyForm::Cube => {
            let (s, c) = elementary::sin_cos(yaw);
            let (full, cut) = (size, size * (1.0 - CHAMFER));
            let corner = |k: usize| {
                let sign = |bit: usize| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
                // Each corner of the cube is three: one on each face.
                let [x, y, z] = match k / 8 {
                    0 => [full, cut, cut],
                    1 => [cut, full, cut],
                    _ => [cut, cut, full],
                };
                let (x, y) = (sign(0) * x, sign(1) * y);
                // The lower edges end in their shadow: what shows there is the sharp outline.
                let z = if sign(2) > 0.0 { z } else { -full };
                [at.x + c * x - s * y, at.y + s * x + c * y, size + z]
            };
            (0..24).map(corner).collect()
        }
        BodyForm::Cylinder => (0..3 * RIM_POINTS)
            .map(|k| {
                let (s, c) = elementary::sin_cos(angle(k));
                let (radius, z) = match k / RIM_POINTS {
                    0 => (size, 0.0),
                    1 => (size, size * (2.0 - CHAMFER)),
                    _ => (size * (1.0 - CHAMFER), 2.0 * size),
                };
                [at.x + radius * c, at.y + radius * s, z]
            })
            .collect(),
        BodyForm::Ball => {
            let centre = [at.x, at.y, size];
            let (to, has_distance) = view.line_of_sight(centre);
            let distance = (to[0] * to[0] + to[1] * to[1] + to[2] * to[2]).sqrt();
            let w = to.map(|x| x / distance);
            // Lines of sight touch the ball on a circle nearer to the camera by size^2/distance.
            let share = if has_distance { (size / distance).min(0.99) } else { 0.0 };
            let (forward, radius) = (size * share, size * (1.0 - share * share).sqrt());
            let flat = elementary::hypot(w[0], w[1]);
            let across = if flat > 1e-9 { [-w[1] / flat, w[0] / flat, 0.0] } else { [1.0, 0.0, 0.0] };
            let up = [
                w[1] * across[2] - w[2] * across[1],
                w[2] * across[0] - w[0] * across[2],
                w[0] * across[1] - w[1] * across[0],
            ];
            // Clockwise with v down is counter-clockwise with v up.
            (0..RIM_POINTS)
                .map(|k| {
                    let (s, c) = elementary::sin_cos(-angle(k));
                    [0, 1, 2].map(|i| centre[i] + forward * w[i] + radius * (c * across[i] + s * up[i]))
                })
                .collect()
        }
    }
}

/// Convex hull by Andrew's monotone chain, in the same sense of rotation as the ball's circle.
fn hull(mut corners: Vec<Corner>) -> Vec<Corner> {
    corners.sort_by(|a, b| a.0[0].total_cmp(&b.0[0]).then(a.0[1].total_cmp(&b.0[1])));
    let turns = |a: [f64; 2], b: [f64; 2], c: [f64; 2]| {
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) > 0.0
    };
    let chain = |points: &mut dyn Iterator<Item = Corner>| {
        let mut chain: Vec<Corner> = vec![];
        for point in points {
            while let [.., a, b] = chain[..] {
                if turns(a.0, b.0, point.0) {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut all = chain(&mut corners.iter().copied());
    all.extend(chain(&mut corners.iter().rev().copied()));
    all
}

impl Spans {
    /// Pixels inside an image of this size.
    pub fn area_within(&self, [width, height]: [usize; 2]) -> usize {
        self.clipped([width, height]).map(|(_, a, b)| b - a).sum()
    }

    pub fn area(&self) -> usize {
        self.rows.iter().map(|[a, b]| (b - a).max(0) as usize).sum()
    }

    /// Row, first column and the one after the last, inside an image of this size.
    pub fn clipped(&self, [width, height]: [usize; 2]) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        let width = width as i32;
        self.rows.iter().enumerate().filter_map(move |(k, &[a, b])| {
            let row = self.top + k as i32;
            let (a, b) = (a.clamp(0, width), b.clamp(0, width));
            (row >= 0 && row < height as i32 && a < b).then_some((row as usize, a as usize, b as usize))
        })
    }

    /// Moved by whole pixels.
    pub fn shifted(&self, [du, dv]: [i32; 2]) -> Spans {
        let rows = self.rows.iter().map(|[a, b]| [a + du, b + du]).collect();
        Spans { top: self.top + dv, rows }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::num::vec2;
    use crate::scene::CLEVRER_CAMERA;

    fn pose(form: BodyForm) -> Pose {
        Pose { form, size: 0.2, at: vec2(0.4, -0.6), yaw: 0.35 }
    }

    fn moved(pose: &Pose, parameter: usize, step: f64) -> Pose {
        let mut moved = *pose;
        match parameter {
            0 => moved.at.x += step,
            1 => moved.at.y += step,
            2 => moved.yaw += step,
            _ => moved.size += step,
        }
        moved
    }

    #[test]
    fn the_outline_moves_as_its_derivatives_say() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        let step = 1e-4;
        for form in [BodyForm::Ball, BodyForm::Cylinder] {
            let pose = pose(form);
            let outline = Outline::new(&view, &pose).unwrap();
            // The support function of the hull: its extent along a normal.
            let support = |o: &Outline, n: [f64; 2]| {
                o.corners.iter().map(|(p, _)| p[0] * n[0] + p[1] * n[1]).fold(f64::NEG_INFINITY, f64::max)
            };
            for parameter in [0, 1, 3] {
                let (more, less) = (moved(&pose, parameter, step), moved(&pose, parameter, -step));
                let (more, less) = (Outline::new(&view, &more).unwrap(), Outline::new(&view, &less).unwrap());
                for p in outline.points(&view, 2.0) {
                    let shift = (support(&more, p.normal) - support(&less, p.normal)) / (2.0 * step);
                    // A polygon's corner is up to half an edge from the point.
                    let tolerance = 0.03 * (1.0 + p.motion[parameter].abs()) + 3.0;
                    assert!(
                        (shift - p.motion[parameter]).abs() < tolerance,
                        "{form:?} {parameter} {shift} {p:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn corners_of_a_cube_move_as_their_derivatives_say() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        let (pose, step) = (pose(BodyForm::Cube), 1e-6);
        let outline = Outline::new(&view, &pose).unwrap();
        for parameter in 0..4 {
            let (more, less) = (moved(&pose, parameter, step), moved(&pose, parameter, -step));
            let (before, after) = (surface_points(&view, &less), surface_points(&view, &more));
            for (k, x) in surface_points(&view, &pose).into_iter().enumerate() {
                let normal = [0.6, -0.8];
                let point = outline.outline_point(&view, x, normal).unwrap();
                let at = |p: Point| view.pixel(p).map(|p| p[0] * normal[0] + p[1] * normal[1]).unwrap();
                let shift = (at(after[k]) - at(before[k])) / (2.0 * step);
                assert!((shift - point.motion[parameter]).abs() < 1e-3, "{parameter} {shift} {point:?}");
            }
        }
    }

    #[test]
    fn creases_lie_inside_the_outline_and_move_with_the_cube() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        let (pose, step) = (pose(BodyForm::Cube), 1e-6);
        let outline = Outline::new(&view, &pose).unwrap();
        let creases = outline.creases(&view, 2.0);
        assert!(creases.len() > 15 && creases.iter().all(|p| p.is_crease));
        let spans = outline.spans();
        for p in &creases {
            let [a, b] = spans.rows[(p.pixel[1] as i32 - spans.top) as usize];
            assert!((f64::from(a)..f64::from(b)).contains(&p.pixel[0]), "{p:?}");
        }
        for parameter in 0..3 {
            let (more, less) = (moved(&pose, parameter, step), moved(&pose, parameter, -step));
            let at = |pose: &Pose| Outline::new(&view, pose).unwrap().creases(&view, 2.0);
            for ((p, more), less) in creases.iter().zip(at(&more)).zip(at(&less)) {
                let shift = (0..2).map(|i| p.normal[i] * (more.pixel[i] - less.pixel[i])).sum::<f64>();
                assert!(
                    (shift / (2.0 * step) - p.motion[parameter]).abs() < 0.5,
                    "{parameter} {shift} {p:?}"
                );
            }
        }
        assert!(
            Outline::new(&view, &Pose { form: BodyForm::Ball, ..pose })
                .unwrap()
                .creases(&view, 2.0)
                .is_empty()
        );
    }

    #[test]
    fn the_outline_of_an_object_is_that_of_its_body() {
        let at = vec2(0.4, -0.6);
        let extent = |shape: Shape, yaw: f64| {
            let outline = outline_of(&CLEVRER_CAMERA, &shape, at, yaw).unwrap();
            let side = |k: usize, start: f64, most: fn(f64, f64) -> f64| {
                outline.iter().map(|p| p[k]).fold(start, most)
            };
            let low = [0, 1].map(|k| side(k, f64::INFINITY, f64::min));
            (low, [0, 1].map(|k| side(k, f64::NEG_INFINITY, f64::max)))
        };
        let centre = CLEVRER_CAMERA.project(at, 0.2).unwrap();
        let box_of = |width| Shape::Rectangle { half_length: 0.2, half_width: width };
        for shape in [Shape::Ball { radius: 0.2 }, Shape::Disc { radius: 0.2 }, box_of(0.2)] {
            let (low, high) = extent(shape, 0.3);
            assert!((0..2).all(|k| low[k] < centre[k] && centre[k] < high[k]), "{shape:?} {low:?} {high:?}");
        }
        // But for its rounded edges a cube is a box.
        let (cube, same) = (extent(Shape::Square { half_side: 0.2 }, 0.3), extent(box_of(0.2), 0.3));
        for k in 0..2 {
            assert!((cube.0[k] - same.0[k]).abs() < 2.0 && (cube.1[k] - same.1[k]).abs() < 2.0);
        }
        let (flat, high) = (extent(box_of(0.1), 0.3), same);
        assert!(flat.1[1] - flat.0[1] < high.1[1] - high.0[1]);
    }

    #[test]
    fn normals_point_outwards() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        for form in FORMS {
            let pose = pose(form);
            let centre = view.pixel([pose.at.x, pose.at.y, pose.size]).unwrap();
            let points = Outline::new(&view, &pose).unwrap().points(&view, 2.0);
            assert!(points.len() > 40, "{form:?} {}", points.len());
            assert!(points.iter().all(|p| {
                (p.pixel[0] - centre[0]) * p.normal[0] + (p.pixel[1] - centre[1]) * p.normal[1] > 0.0
            }));
        }
    }

    #[test]
    fn spans_hold_the_pixels_inside() {
        let view = Viewpoint::new(CLEVRER_CAMERA);
        for form in FORMS {
            let outline = Outline::new(&view, &pose(form)).unwrap();
            let spans = outline.spans();
            let inside = |u: f64, v: f64| {
                outline.corners.iter().enumerate().all(|(k, (a, _))| {
                    let (b, _) = outline.corners[(k + 1) % outline.corners.len()];
                    (b[0] - a[0]) * (v - a[1]) - (b[1] - a[1]) * (u - a[0]) > 0.0
                })
            };
            let mut count = 0;
            for v in 0..320 {
                for u in 0..480 {
                    if inside(u as f64 + 0.5, v as f64 + 0.5) {
                        count += 1;
                        let [a, b] = spans.rows[(v - spans.top) as usize];
                        assert!((a..b).contains(&u), "{form:?} {u} {v} {a} {b}");
                    }
                }
            }
            assert_eq!(count, spans.area_within([480, 320]));
        }
    }
}
