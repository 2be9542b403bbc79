//! Gap between two outlines: distance, normal, and the points that touch first.

use crate::num::{Real, Vec2, vec2};
use crate::scene::Shape;
use crate::world::motion::kinematics::Kinematics;

/// Position (m) and orientation of an outline; `turn` is the unit vector at its yaw.
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct OutlinePose<T> {
    pub position: Vec2<T>,
    pub turn: Vec2<T>,
}

impl<T: Real> OutlinePose<T> {
    pub fn of(k: &Kinematics<T>, shape: &Shape) -> Self {
        OutlinePose::new(k.position, k.yaw, shape)
    }

    pub fn new(position: Vec2<T>, yaw: T, shape: &Shape) -> Self {
        let turn = if shape.is_round() { vec2(T::constant(1.0), T::zero()) } else { Vec2::from_angle(yaw) };
        OutlinePose { position, turn }
    }
}

/// The closest points of two outlines.
#[derive(Debug, Clone, Copy)]
pub(in crate::world) struct Proximity<T> {
    /// Distance (m); negative where they overlap. For two boxes that face corner to corner it is the
    /// separation along the best face normal, a lower bound that vanishes at touch.
    pub gap: T,
    /// Unit normal from a to b.
    pub normal: Vec2<T>,
    /// The points that touch first, on a and on b.
    pub on_a: Vec2<T>,
    pub on_b: Vec2<T>,
    /// The point whose distance from the face is the gap; for two boxes the corner nearest to the face.
    pub lowest: Vec2<T>,
    pub feature: Feature,
}

impl<T: Real> Proximity<T> {
    /// For outlines scaled by `1 + growth` about their centres, to first order. Where two corners meet, the normal stays.
    pub fn grown(self, (a, sa, growth_a): Grown<T>, (b, sb, growth_b): Grown<T>) -> Self {
        let shift = |on: Vec2<T>, centre: Vec2<T>, growth: T, face: bool| {
            let arm = (on - centre) * growth;
            if face { self.normal * self.normal.dot(arm) } else { arm }
        };
        let on_a = self.on_a + shift(self.on_a, a, growth_a, self.feature == Feature::FaceOfA);
        let on_b = self.on_b + shift(self.on_b, b, growth_b, self.feature == Feature::FaceOfB);
        let gap = self.gap + self.normal.dot(on_b - self.on_b - on_a + self.on_a);
        let normal = match (self.feature, sa.is_round(), sb.is_round()) {
            (Feature::Points, false, true) => (b - on_a).unit(),
            (Feature::Points, true, false) => (on_b - a).unit(),
            _ => self.normal,
        };
        Proximity { gap, normal, on_a, on_b, ..self }
    }
}

/// Centre of an outline (m), its shape and its relative growth.
pub(in crate::world) type Grown<'s, T> = (Vec2<T>, &'s Shape, T);

/// Which features touch, and so how the normal rotates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::world) enum Feature {
    /// Two centres or corners: it points from one to the other.
    Points,
    /// It rotates with a face of a.
    FaceOfA,
    /// It rotates with a face of b.
    FaceOfB,
}

/// Two corners whose gaps differ by less than this share a contact (m): bodies are not perfectly rigid.
const COMPLIANCE: f64 = 1e-3;

pub(in crate::world) fn proximity<T: Real>(
    a: &OutlinePose<T>,
    sa: &Shape,
    b: &OutlinePose<T>,
    sb: &Shape,
) -> Proximity<T> {
    match (sa.half_extents(), sb.half_extents()) {
        (None, None) => circles(a.position, sa.bounding_radius(), b.position, sb.bounding_radius()),
        (None, Some(half)) => swapped(box_circle(b, half, a.position, sa.bounding_radius())),
        (Some(half), None) => box_circle(a, half, b.position, sb.bounding_radius()),
        (Some(ha), Some(hb)) => boxes(a, ha, b, hb),
    }
}

/// An outline at a position (m) and yaw (rad).
pub struct PlacedShape<'s> {
    pub position: Vec2,
    pub yaw: f64,
    pub shape: &'s Shape,
}

/// Distance between two outlines (m; negative where they overlap) and the unit normal from the first to the second.
pub fn gap(a: &PlacedShape, b: &PlacedShape) -> (f64, Vec2) {
    let pose = |o: &PlacedShape| OutlinePose::new(o.position, o.yaw, o.shape);
    let near = proximity(&pose(a), a.shape, &pose(b), b.shape);
    (near.gap, near.normal)
}

fn swapped<T: Real>(p: Proximity<T>) -> Proximity<T> {
    let feature = match p.feature {
        Feature::Points => Feature::Points,
        Feature::FaceOfA => Feature::FaceOfB,
        Feature::FaceOfB => Feature::FaceOfA,
    };
    Proximity { normal: -p.normal, on_a: p.on_b, on_b: p.on_a, feature, ..p }
}

fn circles<T: Real>(a: Vec2<T>, ra: f64, b: Vec2<T>, rb: f64) -> Proximity<T> {
    let mut normal = (b - a).unit();
    if normal.x.value() == 0.0 && normal.y.value() == 0.0 {
        normal = vec2(T::constant(1.0), T::zero());
    }
    let gap = (b - a).norm() - (ra + rb);
    let (on_a, on_b) = (a + normal.scaled(ra), b - normal.scaled(rb));
    Proximity { gap, normal, on_a, on_b, lowest: on_b, feature: Feature::Points }
}

/// Box a and circle b: the circle is nearest to a side or to a corner (VRDP supplement, fig. 1).
fn box_circle<T: Real>(a: &OutlinePose<T>, half: [f64; 2], centre: Vec2<T>, radius: f64) -> Proximity<T> {
    let local = (centre - a.position).unrotated(a.turn);
    let (x, y) = (local.x.value(), local.y.value());
    let over = [x.abs() - half[0], y.abs() - half[1]];
    if over[0] > 0.0 && over[1] > 0.0 {
        let corner = vec2(T::constant(half[0].copysign(x)), T::constant(half[1].copysign(y)));
        let corner = a.position + corner.rotated(a.turn);
        return circles(corner, 0.0, centre, radius);
    }
    let (axis, distance, nearest) = if over[0] >= over[1] {
        let sign = 1f64.copysign(x);
        (a.turn.scaled(sign), local.x * sign - half[0], vec2(T::constant(half[0] * sign), local.y))
    } else {
        let sign = 1f64.copysign(y);
        (a.turn.perp().scaled(sign), local.y * sign - half[1], vec2(local.x, T::constant(half[1] * sign)))
    };
    let on_b = centre - axis.scaled(radius);
    Proximity {
        gap: distance - radius,
        normal: axis,
        on_a: a.position + nearest.rotated(a.turn),
        on_b,
        lowest: on_b,
        feature: Feature::FaceOfA,
    }
}

/// The points at which two outlines can touch: both ends of the edge where two boxes meet.
pub(in crate::world) fn manifold<T: Real>(
    a: &OutlinePose<T>,
    sa: &Shape,
    b: &OutlinePose<T>,
    sb: &Shape,
) -> [Option<Proximity<T>>; 2] {
    let (Some(ha), Some(hb)) = (sa.half_extents(), sb.half_extents()) else {
        return [Some(proximity(a, sa, b, sb)), None];
    };
    let (fa, fb) = (best_face(a, ha, b, hb), best_face(b, hb, a, ha));
    if fa.0 >= fb.0 {
        let face = facing_edge(a, ha, fa.1, b, hb);
        [Some(face.point(0)), Some(face.point(1))]
    } else {
        let face = facing_edge(b, hb, fb.1, a, ha);
        [Some(swapped(face.point(0))), Some(swapped(face.point(1)))]
    }
}

/// Two boxes, by the separating-axis theorem.
fn boxes<T: Real>(a: &OutlinePose<T>, ha: [f64; 2], b: &OutlinePose<T>, hb: [f64; 2]) -> Proximity<T> {
    let (fa, fb) = (best_face(a, ha, b, hb), best_face(b, hb, a, ha));
    if fa.0 >= fb.0 {
        facing_edge(a, ha, fa.1, b, hb).blended()
    } else {
        swapped(facing_edge(b, hb, fb.1, a, ha).blended())
    }
}

/// The face of `a` (axis, sign) that separates `b` most, by real parts.
fn best_face<T: Real>(
    a: &OutlinePose<T>,
    ha: [f64; 2],
    b: &OutlinePose<T>,
    hb: [f64; 2],
) -> (f64, (usize, f64)) {
    let (ta, tb) = (a.turn.value(), b.turn.value());
    let delta = b.position.value() - a.position.value();
    let mut best = (f64::NEG_INFINITY, (0, 1.0));
    for (axis, direction) in [ta, ta.perp()].into_iter().enumerate() {
        let along = direction.dot(delta);
        let reach = hb[0] * direction.dot(tb).abs() + hb[1] * direction.dot(tb.perp()).abs();
        let separation = along.abs() - ha[axis] - reach;
        if separation > best.0 {
            best = (separation, (axis, 1f64.copysign(along)));
        }
    }
    best
}

/// An edge of one box opposite a face of another: its two ends, clipped to the face.
struct FacingEdge<T> {
    normal: Vec2<T>,
    tangent: Vec2<T>,
    /// Middle of the face.
    middle: Vec2<T>,
    /// Position along the face, and height above it, of each end (m).
    sides: [T; 2],
    heights: [T; 2],
    /// The end nearest to the face before clipping, and its height.
    lowest: Vec2<T>,
    gap: T,
}

fn facing_edge<T: Real>(
    a: &OutlinePose<T>,
    ha: [f64; 2],
    (axis, sign): (usize, f64),
    b: &OutlinePose<T>,
    hb: [f64; 2],
) -> FacingEdge<T> {
    let direction = if axis == 0 { a.turn } else { a.turn.perp() };
    let normal = direction.scaled(sign);
    let tangent = normal.perp();
    let (width, nv) = (ha[1 - axis], normal.value());
    // The edge of b whose outward normal is most opposed to the face.
    let tb = b.turn.value();
    let (dx, dy) = (nv.dot(tb), nv.dot(tb.perp()));
    let corners = if dx.abs() >= dy.abs() {
        let x = -hb[0].copysign(dx);
        [vec2(x, -hb[1]), vec2(x, hb[1])]
    } else {
        let y = -hb[1].copysign(dy);
        [vec2(-hb[0], y), vec2(hb[0], y)]
    };
    let ends = corners.map(|c| b.position - a.position + Vec2::constant(c).rotated(b.turn));
    let heights = ends.map(|e| normal.dot(e) - ha[axis]);
    let sides = ends.map(|e| tangent.dot(e));
    let span = sides[1] - sides[0];
    let clip = |k: usize| -> (T, T) {
        let clipped = sides[k].value().clamp(-width, width);
        if clipped == sides[k].value() || span.value().abs() < 1e-12 {
            return (sides[k], heights[k]);
        }
        let side = T::constant(clipped);
        (side, heights[0] + (heights[1] - heights[0]) * ((side - sides[0]) / span))
    };
    let ((s0, h0), (s1, h1)) = (clip(0), clip(1));
    let lower = if heights[1].value() < heights[0].value() { 1 } else { 0 };
    let (gap, lowest) = (heights[lower], a.position + ends[lower]);
    let middle = a.position + normal.scaled(ha[axis]);
    FacingEdge { normal, tangent, middle, sides: [s0, s1], heights: [h0, h1], lowest, gap }
}

impl<T: Real> FacingEdge<T> {
    /// The contact at one end.
    fn point(&self, k: usize) -> Proximity<T> {
        let p = self.at(self.sides[k], self.heights[k]);
        Proximity { lowest: p.on_b, ..p }
    }

    /// One contact for both ends, weighted by how nearly they touch.
    fn blended(&self) -> Proximity<T> {
        let ([s0, s1], [h0, h1]) = (self.sides, self.heights);
        let weight = ((h0 - h1) / COMPLIANCE).tanh() * 0.5 + 0.5; // of end 1
        self.at(s0 + (s1 - s0) * weight, self.gap)
    }

    fn at(&self, side: T, gap: T) -> Proximity<T> {
        let on_a = self.middle + self.tangent * side;
        let on_b = on_a + self.normal * gap;
        Proximity { gap, normal: self.normal, on_a, on_b, lowest: self.lowest, feature: Feature::FaceOfA }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shape(kind: u8) -> Shape {
        match kind % 4 {
            0 => Shape::Disc { radius: 0.2 },
            1 => Shape::Ball { radius: 0.15 },
            2 => Shape::Square { half_side: 0.2 },
            _ => Shape::Rectangle { half_length: 0.3, half_width: 0.1 },
        }
    }

    proptest! {
        #[test]
        fn seen_from_the_other_body_it_is_the_mirror_image(
            ka in 0u8..4, kb in 0u8..4, x in -1.0..1.0f64, y in -1.0..1.0f64, qa in -3.0..3.0f64, qb in -3.0..3.0f64,
        ) {
            let (sa, sb) = (shape(ka), shape(kb));
            prop_assume!(x.hypot(y) > 0.3);
            let a = OutlinePose::new(vec2(0.0, 0.0), qa, &sa);
            let b = OutlinePose::new(vec2(x, y), qb, &sb);
            let (p, q) = (proximity(&a, &sa, &b, &sb), proximity(&b, &sb, &a, &sa));
            prop_assert!((p.gap - q.gap).abs() < 1e-12);
            prop_assert!((p.normal + q.normal).norm() < 1e-9);
            prop_assert!((p.normal.norm() - 1.0).abs() < 1e-12);
            // Moving b along the normal opens the gap by as much, unless another face takes over.
            let moved = OutlinePose::new(b.position + p.normal.scaled(1e-7), qb, &sb);
            let wider = proximity(&a, &sa, &moved, &sb).gap - p.gap;
            prop_assert!((wider - 1e-7).abs() < 1e-11, "{wider}");
        }
    }

    #[test]
    fn faces_and_corners_are_distinguished() {
        let square = Shape::Square { half_side: 0.2 };
        let ball = Shape::Ball { radius: 0.1 };
        let at = |x: f64, y: f64, yaw: f64, s: &Shape| OutlinePose::new(vec2(x, y), yaw, s);
        let face = proximity(&at(0., 0., 0., &square), &square, &at(0.5, 0.1, 0., &ball), &ball);
        assert!((face.gap - 0.2).abs() < 1e-12 && face.feature == Feature::FaceOfA);
        let corner = proximity(&at(0., 0., 0., &square), &square, &at(0.5, 0.6, 0., &ball), &ball);
        assert!((corner.gap - 0.4).abs() < 1e-12 && corner.feature == Feature::Points);
        let flat = proximity(&at(0., 0., 0., &square), &square, &at(0.5, 0.1, 0., &square), &square);
        assert!((flat.gap - 0.1).abs() < 1e-12 && (flat.on_a.y - 0.05).abs() < 1e-12);
    }
}
