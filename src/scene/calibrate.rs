//! Estimates a camera from points whose place is known in the image and in the world.
//!
//! A direct linear transform (Hartley and Zisserman, Multiple View Geometry, 2nd ed., algorithms 4.1 and 7.1) on random
//! minimal sets, the one with the least median residual kept, gives the start; then the reprojection error is minimised
//! over focal length, pixel aspect, principal point and pose, outliers left out. Weak priors stand for what points do not
//! tell: points of one plane (an annotated table) leave the lens undetermined in part.

use super::camera::{Camera, CameraPose, Intrinsics, Rotation};
use crate::num::{Vec2, vec2};
use nalgebra::{DMatrix, Matrix3, Matrix3x4, Rotation3, SMatrix, SVector, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Most pairs: more add nothing.
pub const MAX_PAIRS: usize = 20_000;
/// Points of one plane need four pairs.
const FEWEST: usize = 4;
/// Random minimal sets that are tried: one of them is free of outliers, as good as surely, up to 40 % of those.
const TRIALS: usize = 400;
/// Most pairs by which a trial is judged.
const JUDGES: usize = 400;
/// A pair farther than this many deviations from where the camera shows it is an outlier.
const OUTLIER: f64 = 4.0;
/// Thickness of the points, as a share of their extent, up to which they are taken for a plane at the start, and from
/// which they are taken for a volume.
const FLAT: f64 = 0.05;
const SOLID: f64 = 0.01;
/// Width of the points, as a share of their extent, below which they lie on a line.
const LINE: f64 = 1e-3;
/// Area of three of four points in the image, as a share of the largest such, below which they lie on a line.
const CORNER: f64 = 0.01;
/// Deviation of a pixel that is taken where the pairs are too few to tell (px), and the least that is believed.
const USUAL_SIGMA: f64 = 1.0;
const LEAST_SIGMA: f64 = 1e-3;
/// Residuals beyond the parameters from which the deviation is estimated.
const ENOUGH: usize = 8;
/// Focal length that is likely, as a share of the image's width, and the deviation of its logarithm.
const FOCAL: (f64, f64) = (1.2, 0.7);
/// Deviations of the logarithm of the pixels' aspect, and of the principal point from the image's centre as a share of
/// the image's size.
const ASPECT: f64 = 0.01;
const CENTRE: f64 = 0.03;
/// A mean error beyond this share of the image's width is no calibration.
const USELESS: f64 = 0.05;

/// One point, in the image (px) and in the world (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointPair {
    pub image: [f64; 2],
    pub world: [f64; 3],
}

/// A camera that was estimated.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    pub camera: Camera,
    pub intrinsics: Intrinsics,
    /// Deviation of the focal length along u (px).
    pub focal_sd: f64,
    /// Where the camera stands (m).
    pub position: [f64; 3],
    /// Root mean square distance, a coordinate (px), over the pairs that are no outliers.
    pub reprojection_error: f64,
    /// Indices of the pairs that were left out.
    pub outliers: Vec<usize>,
    /// Whether the points lie in one plane: heights far from it are then known through the priors of the lens only.
    pub planar: bool,
}

#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    #[error("pairs: {given} were given; at least {FEWEST}, not on one line, are needed")]
    TooFew { given: usize },
    #[error("pairs: {given} were given; at most {MAX_PAIRS} are read")]
    TooMany { given: usize },
    #[error("pairs[{index}].{field}: is not finite; give a finite number")]
    NotFinite { index: usize, field: &'static str },
    #[error("image_size: is {width} x {height}; give width and height in pixels")]
    ImageSize { width: f64, height: f64 },
    #[error("pairs: all {field} points lie on one line; give points that span the table")]
    OnALine { field: &'static str },
    #[error("pairs: of four points three lie on one line in the image; give four corners, or more points")]
    ThreeOnALine,
    #[error(
        "pairs: they are those of a mirror: an axis is mirrored, or corners are in the wrong order; u goes right, v down, \
         and the world is right-handed with z up (from above, y is a quarter turn counter-clockwise from x)"
    )]
    Mirrored,
    #[error(
        "pairs: no camera explains them: the best misses by {error:.1} px; check the order of the points and the units"
    )]
    NoCamera { error: f64 },
}

/// Focal length and aspect as logarithms, principal point, rotation vector, translation.
type Parameters = SVector<f64, 10>;

/// Estimates the camera of an image of this size (px) from points. Deterministic. Up to about 40 % of the pairs may be
/// wrong, where there are many; of fewer than eight none is left out.
pub fn calibrate(pairs: &[PointPair], image_size: [f64; 2]) -> Result<Calibration, CalibrateError> {
    check(pairs, image_size)?;
    let cloud = Cloud::of(pairs)?;
    let best = best(pairs, &cloud, image_size);
    // A mirrored volume fits no camera, but its mirror image does; a mirrored plane is one seen from below.
    let mirror = |p: &PointPair| PointPair { image: [p.image[0], image_size[1] - p.image[1]], ..*p };
    if cloud.thickness >= SOLID {
        let mirrored: Vec<PointPair> = pairs.iter().map(mirror).collect();
        let reflected = self::best(&mirrored, &cloud, image_size);
        if reflected.as_ref().map_or(f64::INFINITY, |m| m.sigma)
            < 0.5 * best.as_ref().map_or(f64::INFINITY, |b| b.sigma)
        {
            return Err(CalibrateError::Mirrored);
        }
    }
    let Some(found) = best else { return Err(CalibrateError::NoCamera { error: image_size[0] }) };
    let (intrinsics, pose) = parts(&found.at, image_size);
    let (rotation, translation) = (rotation(&found.at), Vector3::from(pose.translation));
    let position = -(rotation.inverse() * translation);
    // Of a wall nobody knows which side is seen; a table is seen from above.
    let below = (position - cloud.centre).dot(&cloud.normal) < 0.0;
    if below && cloud.normal.z > 0.5 && cloud.thickness < FLAT {
        return Err(CalibrateError::Mirrored);
    }
    let residuals: Vec<f64> = pairs.iter().map(|p| distance(&found.at, p, image_size)).collect();
    let kept = |r: &&f64| pairs.len() < 2 * FEWEST || **r <= OUTLIER * found.sigma;
    let inliers = residuals.iter().filter(kept).count();
    let squares: f64 = residuals.iter().filter(kept).map(|r| r * r).sum();
    let error = (squares / (2 * inliers).max(1) as f64).sqrt();
    if inliers < FEWEST || !error.is_finite() || error > USELESS * image_size[0] {
        return Err(CalibrateError::NoCamera { error });
    }
    let camera =
        Camera::from_parts(&intrinsics, &pose, image_size).map_err(|_| CalibrateError::NoCamera { error })?;
    Ok(Calibration {
        camera,
        intrinsics,
        focal_sd: intrinsics.focal[0] * found.focal_sd,
        position: position.into(),
        reprojection_error: error,
        outliers: (0..pairs.len()).filter(|&i| !kept(&&residuals[i])).collect(),
        planar: cloud.thickness < SOLID,
    })
}

fn check(pairs: &[PointPair], [width, height]: [f64; 2]) -> Result<(), CalibrateError> {
    if pairs.len() < FEWEST {
        return Err(CalibrateError::TooFew { given: pairs.len() });
    }
    if pairs.len() > MAX_PAIRS {
        return Err(CalibrateError::TooMany { given: pairs.len() });
    }
    if !((1.0..=1e6).contains(&width) && (1.0..=1e6).contains(&height)) {
        return Err(CalibrateError::ImageSize { width, height });
    }
    for (index, pair) in pairs.iter().enumerate() {
        let fields = [("image", &pair.image[..]), ("world", &pair.world[..])];
        if let Some((field, _)) = fields.iter().find(|f| f.1.iter().any(|v| !(-1e9..1e9).contains(v))) {
            return Err(CalibrateError::NotFinite { index, field });
        }
    }
    if let [a, b, c, d] = pairs {
        let [a, b, c, d] = [a, b, c, d].map(|p| vec2(p.image[0], p.image[1]));
        let area = |[p, q, r]: [Vec2; 3]| (q - p).cross(r - p).abs();
        let areas = [[a, b, c], [a, b, d], [a, c, d], [b, c, d]].map(area);
        let widest = areas.into_iter().fold(0.0, f64::max);
        // All on one line is told elsewhere.
        if widest > 0.0 && areas.into_iter().any(|area| area <= CORNER * widest) {
            return Err(CalibrateError::ThreeOnALine);
        }
    }
    Ok(())
}

/// The world points' best plane.
struct Cloud {
    centre: Vector3<f64>,
    /// Columns: two directions in the plane, and its normal, which points up; right-handed.
    axes: Matrix3<f64>,
    normal: Vector3<f64>,
    /// Extent across the plane as a share of that along it.
    thickness: f64,
}

impl Cloud {
    fn of(pairs: &[PointPair]) -> Result<Cloud, CalibrateError> {
        let n = pairs.len() as f64;
        let spread = |points: &dyn Fn(&PointPair) -> Vector3<f64>| {
            let centre = pairs.iter().map(points).sum::<Vector3<f64>>() / n;
            let offs = pairs.iter().map(|p| points(p) - centre);
            let scatter = offs.map(|d| d * d.transpose()).sum::<Matrix3<f64>>() / n;
            (centre, scatter.symmetric_eigen())
        };
        let extents = |eigen: &nalgebra::SymmetricEigen<f64, nalgebra::U3>| {
            let mut order = [0, 1, 2];
            order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
            (order, order.map(|k| eigen.eigenvalues[k].max(0.0).sqrt()))
        };
        let (_, in_image) = spread(&|p| Vector3::new(p.image[0], p.image[1], 0.0));
        let (centre, eigen) = spread(&|p| Vector3::from(p.world));
        for (field, eigen) in [("world", &eigen), ("image", &in_image)] {
            let (_, [long, wide, _]) = extents(eigen);
            if wide <= LINE * long {
                return Err(CalibrateError::OnALine { field });
            }
        }
        let (order, [long, _, thick]) = extents(&eigen);
        let mut normal: Vector3<f64> = eigen.eigenvectors.column(order[2]).into_owned();
        if normal.z < 0.0 {
            normal = -normal;
        }
        let first: Vector3<f64> = eigen.eigenvectors.column(order[0]).into_owned();
        let axes = Matrix3::from_columns(&[first, normal.cross(&first), normal]);
        Ok(Cloud { centre, axes, normal, thickness: thick / long })
    }
}

/// Parameters, the pairs' deviation there (px), and the deviation of the focal length's logarithm.
struct Found {
    at: Parameters,
    sigma: f64,
    focal_sd: f64,
}

/// The best camera over all starts.
fn best(pairs: &[PointPair], cloud: &Cloud, size: [f64; 2]) -> Option<Found> {
    let mut starts: Vec<Parameters> = vec![];
    if cloud.thickness < FLAT {
        let flat: Vec<([f64; 2], Vec<f64>)> = pairs
            .iter()
            .map(|p| {
                let along = cloud.axes.transpose() * (Vector3::from(p.world) - cloud.centre);
                (p.image, vec![along.x, along.y, 1.0])
            })
            .collect();
        if let Some(h) = least_median(&flat, FEWEST) {
            starts.extend(from_plane(&Matrix3::from_fn(|i, j| h[(i, j)]), cloud, size));
        }
    }
    if cloud.thickness >= SOLID && pairs.len() >= 6 {
        let solid: Vec<([f64; 2], Vec<f64>)> =
            pairs.iter().map(|p| (p.image, vec![p.world[0], p.world[1], p.world[2], 1.0])).collect();
        let p = least_median(&solid, 6);
        starts.extend(p.and_then(|p| from_matrix(&Matrix3x4::from_fn(|i, j| p[(i, j)]), size)));
    }
    let refined = starts.into_iter().map(|start| robust(pairs, start, size));
    refined.filter(|f| f.sigma.is_finite()).min_by(|a, b| a.sigma.total_cmp(&b.sigma))
}

/// The projective map (3 x columns) from homogeneous points to pixels whose residuals have the least median, over random
/// minimal sets; refined on the better half.
fn least_median(points: &[([f64; 2], Vec<f64>)], minimal: usize) -> Option<DMatrix<f64>> {
    let mut random = ChaCha8Rng::seed_from_u64(points.len() as u64);
    let stride = points.len().div_ceil(JUDGES);
    let judges: Vec<usize> = (0..points.len()).step_by(stride).collect();
    let miss = |map: &DMatrix<f64>, i: usize| {
        let (image, world) = &points[i];
        let [u, v, w] =
            [0, 1, 2].map(|r| world.iter().enumerate().map(|(c, x)| map[(r, c)] * x).sum::<f64>());
        (u / w - image[0]).hypot(v / w - image[1])
    };
    let median = |map: &DMatrix<f64>| {
        let mut misses: Vec<f64> = judges.iter().map(|&i| miss(map, i)).filter(|m| m.is_finite()).collect();
        let middle = misses.len() / 2;
        (2 * misses.len() > judges.len()).then(|| *misses.select_nth_unstable_by(middle, f64::total_cmp).1)
    };
    let all: Vec<usize> = (0..points.len()).collect();
    let mut candidates: Vec<DMatrix<f64>> = linear(points, &all).into_iter().collect();
    if points.len() >= 2 * FEWEST {
        for _ in 0..TRIALS {
            let mut set: Vec<usize> = vec![];
            while set.len() < minimal {
                let i = (random.next_u64() % points.len() as u64) as usize;
                if !set.contains(&i) {
                    set.push(i);
                }
            }
            candidates.extend(linear(points, &set));
        }
    }
    let judged = candidates.into_iter().filter_map(|map| Some((median(&map)?, map)));
    let (limit, map) = judged.min_by(|a, b| a.0.total_cmp(&b.0))?;
    let near: Vec<usize> = all.into_iter().filter(|&i| miss(&map, i) <= 2.5 * limit).collect();
    let polished = linear(points, &near).filter(|p| median(p).is_some_and(|m| m <= limit));
    Some(polished.unwrap_or(map))
}

/// Direct linear transform with Hartley's normalisation.
fn linear(points: &[([f64; 2], Vec<f64>)], set: &[usize]) -> Option<DMatrix<f64>> {
    let columns = points.first()?.1.len();
    let n = set.len() as f64;
    let scaling = |value: &dyn Fn(usize, usize) -> f64, dims: usize| {
        let centre: Vec<f64> = (0..dims).map(|d| set.iter().map(|&i| value(i, d)).sum::<f64>() / n).collect();
        let square = |i: &usize| (0..dims).map(|d| (value(*i, d) - centre[d]).powi(2)).sum::<f64>();
        let size = (set.iter().map(square).sum::<f64>() / n / dims as f64).sqrt();
        (size > 0.0).then(|| {
            DMatrix::from_fn(dims + 1, dims + 1, |r, c| match (r == c, c == dims) {
                (true, true) => 1.0,
                (true, false) => 1.0 / size,
                (false, true) => -centre[r] / size,
                _ => 0.0,
            })
        })
    };
    let to_image = scaling(&|i, d| points[i].0[d], 2)?;
    let to_world = scaling(&|i, d| points[i].1[d], columns - 1)?;
    let mut normal = DMatrix::zeros(3 * columns, 3 * columns);
    for &i in set {
        let ([u, v], world) = &points[i];
        let x = &to_world * nalgebra::DVector::from_column_slice(world);
        let p = &to_image * nalgebra::DVector::from_column_slice(&[*u, *v, 1.0]);
        for (at, coordinate) in [(0, p[0]), (1, p[1])] {
            let mut row = nalgebra::DVector::zeros(3 * columns);
            for c in 0..columns {
                row[at * columns + c] = x[c];
                row[2 * columns + c] = -coordinate * x[c];
            }
            normal.ger(1.0, &row, &row, 1.0);
        }
    }
    let eigen = normal.symmetric_eigen();
    let least = (0..3 * columns).min_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]))?;
    let map = DMatrix::from_fn(3, columns, |r, c| eigen.eigenvectors[(r * columns + c, least)]);
    let map = to_image.try_inverse()? * map * to_world;
    map.iter().all(|v| v.is_finite()).then_some(map)
}

/// Starts from a homography of the points' plane: with the focal length that it implies (square pixels, principal point
/// in the middle), and with likely ones.
fn from_plane(h: &Matrix3<f64>, cloud: &Cloud, size: [f64; 2]) -> Vec<Parameters> {
    let middle = Matrix3::new(1.0, 0.0, -0.5 * size[0], 0.0, 1.0, -0.5 * size[1], 0.0, 0.0, 1.0);
    let h = middle * h;
    let (a, b) = (h.column(0), h.column(1));
    // Columns of K^-1 H are perpendicular and of one length (Zhang, 2000).
    let (perpendicular, across) = (a[0] * b[0] + a[1] * b[1], a[2] * b[2]);
    let (length, along) = (a[0] * a[0] + a[1] * a[1] - b[0] * b[0] - b[1] * b[1], a[2] * a[2] - b[2] * b[2]);
    let square = -(perpendicular * across + length * along) / (across * across + along * along);
    let usual = FOCAL.0 * size[0];
    let implied = Some(square.sqrt()).filter(|f| f.is_finite() && (0.1 * usual..10.0 * usual).contains(f));
    let focals = implied.into_iter().chain([0.5, 1.0, 2.0].map(|share| share * usual));
    let start = |focal: f64| {
        let bare = Matrix3::from_diagonal(&Vector3::new(1.0 / focal, 1.0 / focal, 1.0)) * h;
        let scale = 0.5 * (bare.column(0).norm() + bare.column(1).norm()) * bare[(2, 2)].signum();
        let bare = bare / scale;
        let (x, y, t): (Vector3<f64>, Vector3<f64>, Vector3<f64>) =
            (bare.column(0).into(), bare.column(1).into(), bare.column(2).into());
        let turn = nearest_rotation(&Matrix3::from_columns(&[x, y, x.cross(&y)]))? * cloud.axes.transpose();
        parameters(focal, [0.0; 2], &turn, t - turn * cloud.centre)
    };
    focals.filter_map(start).collect()
}

/// The start from a whole projection matrix.
fn from_matrix(p: &Matrix3x4<f64>, size: [f64; 2]) -> Option<Parameters> {
    let left = p.fixed_view::<3, 3>(0, 0).into_owned();
    let p = p * (left.determinant().signum() / left.row(2).norm());
    let row = |i: usize| Vector3::new(p[(i, 0)], p[(i, 1)], p[(i, 2)]);
    let (cx, cy) = (row(0).dot(&row(2)), row(1).dot(&row(2)));
    let (x, y) = (row(0) - row(2) * cx, row(1) - row(2) * cy);
    let (fx, fy) = (x.norm(), y.norm());
    let turn = nearest_rotation(&Matrix3::from_rows(&[
        (x / fx).transpose(),
        (y / fy).transpose(),
        row(2).transpose(),
    ]))?;
    let t = Vector3::new((p[(0, 3)] - cx * p[(2, 3)]) / fx, (p[(1, 3)] - cy * p[(2, 3)]) / fy, p[(2, 3)]);
    parameters((fx * fy).sqrt(), [cx - 0.5 * size[0], cy - 0.5 * size[1]], &turn, t)
}

fn nearest_rotation(m: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let svd = m.svd(true, true);
    let turn = svd.u? * svd.v_t?;
    (turn.determinant() > 0.0).then_some(turn)
}

fn parameters(focal: f64, off: [f64; 2], turn: &Matrix3<f64>, t: Vector3<f64>) -> Option<Parameters> {
    // By the quaternion: half a turn, straight down, has no axis in the matrix's skew part.
    let axis = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(*turn)).scaled_axis();
    let all = [focal.ln(), 0.0, off[0], off[1], axis.x, axis.y, axis.z, t.x, t.y, t.z];
    all.iter().all(|v| v.is_finite()).then(|| Parameters::from(all))
}

fn rotation(at: &Parameters) -> Rotation3<f64> {
    Rotation3::from_scaled_axis(Vector3::new(at[4], at[5], at[6]))
}

fn parts(at: &Parameters, size: [f64; 2]) -> (Intrinsics, CameraPose) {
    let (focal, aspect) = (at[0].exp(), at[1].exp());
    let centre = [0.5 * size[0] + at[2], 0.5 * size[1] + at[3]];
    let turn = rotation(at);
    let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| turn[(i, j)]));
    let pose = CameraPose { rotation: Rotation::Matrix(rows), translation: [at[7], at[8], at[9]] };
    (Intrinsics { focal: [focal, focal * aspect], centre }, pose)
}

/// Pixel of a world point less where it was seen; `None` behind the camera.
fn off(at: &Parameters, turn: &Rotation3<f64>, pair: &PointPair, size: [f64; 2]) -> Option<[f64; 2]> {
    let p = turn * Vector3::from(pair.world) + Vector3::new(at[7], at[8], at[9]);
    let (focal, aspect) = (at[0].exp(), at[1].exp());
    let u = 0.5 * size[0] + at[2] + focal * p.x / p.z;
    let v = 0.5 * size[1] + at[3] + focal * aspect * p.y / p.z;
    (p.z > 0.0).then(|| [u - pair.image[0], v - pair.image[1]])
}

/// Distance in the image (px); infinite behind the camera.
fn distance(at: &Parameters, pair: &PointPair, size: [f64; 2]) -> f64 {
    off(at, &rotation(at), pair, size).map_or(f64::INFINITY, |[u, v]| u.hypot(v))
}

/// Least squares on the pairs within [`OUTLIER`] deviations, the deviation estimated anew in each round.
fn robust(pairs: &[PointPair], start: Parameters, size: [f64; 2]) -> Found {
    let sigma = |at: &Parameters| {
        if 2 * pairs.len() < 10 + ENOUGH {
            return USUAL_SIGMA;
        }
        let mut all: Vec<f64> = pairs.iter().map(|p| distance(at, p, size)).collect();
        let middle = all.len() / 2;
        // Median of the distance of a plane normal deviate.
        (*all.select_nth_unstable_by(middle, f64::total_cmp).1 / 1.177_410_022_515_474_6).max(LEAST_SIGMA)
    };
    let mut found = Found { at: start, sigma: sigma(&start), focal_sd: FOCAL.1 };
    for _ in 0..6 {
        let near = |p: &&PointPair| {
            pairs.len() < 2 * FEWEST || distance(&found.at, p, size) <= OUTLIER * found.sigma
        };
        let inliers: Vec<PointPair> = pairs.iter().filter(near).copied().collect();
        let (at, focal_sd) = refine(&inliers, found.at, found.sigma, size);
        let before = found.sigma;
        found = Found { at, sigma: sigma(&at), focal_sd };
        if (found.sigma / before - 1.0).abs() < 1e-3 {
            break;
        }
    }
    if 2 * pairs.len() < 10 + ENOUGH {
        // Too few to estimate a deviation, but starts must be told apart.
        let squares: f64 = pairs.iter().map(|p| distance(&found.at, p, size).powi(2)).sum();
        found.sigma = USUAL_SIGMA.max((squares / pairs.len() as f64).sqrt());
    }
    found
}

/// Levenberg and Marquardt's method on reprojection errors and priors; also the deviation of the first parameter.
fn refine(pairs: &[PointPair], start: Parameters, sigma: f64, size: [f64; 2]) -> (Parameters, f64) {
    let mean = |k: usize| if k == 0 { (FOCAL.0 * size[0]).ln() } else { 0.0 };
    let prior = [FOCAL.1, ASPECT, CENTRE * size[0], CENTRE * size[1]];
    let cost = |at: &Parameters| {
        let turn = rotation(at);
        let square =
            |p| off(at, &turn, p, size).map_or(f64::INFINITY, |[u, v]| (u * u + v * v) / (sigma * sigma));
        let of_priors: f64 = prior.iter().enumerate().map(|(k, sd)| ((at[k] - mean(k)) / sd).powi(2)).sum();
        pairs.iter().map(square).sum::<f64>() + of_priors
    };
    let (mut at, mut damping) = (start, 1e-3);
    let mut now = cost(&at);
    let mut focal_sd = prior[0];
    for _ in 0..100 {
        let mut hessian = SMatrix::<f64, 10, 10>::zeros();
        let mut gradient = Parameters::zeros();
        for (k, sd) in prior.iter().enumerate() {
            hessian[(k, k)] += 1.0 / (sd * sd);
            gradient[k] += (at[k] - mean(k)) / (sd * sd);
        }
        let moved: [[(Parameters, Rotation3<f64>, f64); 2]; 10] = std::array::from_fn(|k| {
            let step = 1e-6 * if matches!(k, 2 | 3) { size[0] } else { at[k].abs().max(1.0) };
            [step, -step].map(|step| {
                let mut at = at;
                at[k] += step;
                (at, rotation(&at), step)
            })
        });
        let turn = rotation(&at);
        for pair in pairs {
            let Some(r) = off(&at, &turn, pair, size) else { continue };
            let slope = |k: usize, c: usize| {
                let [(a, ta, step), (b, tb, _)] = &moved[k];
                let value = |at, turn| off(at, turn, pair, size).map_or(r[c], |r| r[c]);
                (value(a, ta) - value(b, tb)) / (2.0 * step * sigma)
            };
            for (c, residual) in r.into_iter().enumerate() {
                let j = Parameters::from_fn(|k, _| slope(k, c));
                hessian += j * j.transpose();
                gradient += j * (residual / sigma);
            }
        }
        focal_sd = hessian.try_inverse().map_or(focal_sd, |inverse| inverse[(0, 0)].max(0.0).sqrt());
        let mut better = false;
        while damping < 1e12 {
            let mut damped = hessian;
            (0..10).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let Some(step) = damped.cholesky().map(|c| c.solve(&gradient)) else {
                damping *= 10.0;
                continue;
            };
            let trial = at - step;
            let then = cost(&trial);
            if then < now {
                better = now - then > 1e-10 * (1.0 + now);
                (at, now, damping) = (trial, then, (0.1 * damping).max(1e-12));
                break;
            }
            damping *= 10.0;
        }
        if !better {
            break;
        }
    }
    (at, focal_sd)
}
